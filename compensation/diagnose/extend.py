"""The extension of a calibration by findings: terms are appended, constants are shifted."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from typing import Any

import numpy as np

from armd import __version__
from armd.arrays import F64
from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.constants import NEGLIGIBLE
from armd.compensation.diagnose.fitting.curves import as_curve
from armd.compensation.diagnose.fitting.neighbourhood import move_model
from armd.compensation.diagnose.fitting.nuisance import make_mount_term
from armd.compensation.diagnose.problem.amplitudes import is_curve
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.effects.by_session import as_written, is_by_session
from armd.compensation.effects.effect import Candidate
from armd.compensation.identify.thermal.terms import GROWTH_KNOWN
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import ArtefactCorrection, Calibration, name_constants
from armd.compensation.model.terms import Term


def extend_calibration(
    last: Fit,
    arm: Arm,
    sessions: Sequence[Session],
    command: str = "",
    left_out: Sequence[Candidate] = (),
    growth: bool = False,
) -> Calibration:
    """Extend the calibration under test by the findings' terms, all identified together.

    *growth*: the first link's expansion is added, too. *left_out*: findings that held-out readings
    do not validate; the provenance lists them. A constant that shifted stays a constant.
    Corrections of the artefact are in `artefact`, which `evaluate` applies and `correct` does not.
    """
    calibration = last.baseline.calibration
    if not last.findings:
        if not left_out:
            return calibration
        provenance = _make_provenance(last, sessions, command, left_out)
        return calibration.model_copy(update={"provenance": provenance, "content_sha256": ""})
    model = move_model(last)
    constants = model.constants.copy()
    names = list(arm.layout.names)
    # Each row: how an identified quantity moves with the solution, for the covariance.
    rows: list[tuple[str, F64]] = _make_identified_rows(last, names)
    terms = list(model.terms)
    for candidate, values, span in zip(
        last.findings, last.amplitudes, last.layout.findings, strict=True
    ):
        if is_curve(candidate):
            terms.append(as_curve(candidate, values, last.linear.rests.observations.states.q))
            continue
        label = f"{candidate.cause} {candidate.location}"
        if is_by_session(candidate):
            for written in as_written(candidate, values, label):
                constants[names.index(written.parameter)] += float(written.constant @ values)
                for j, share in enumerate(written.constant):
                    _add_move(rows, written.parameter, span.start + j, float(share), last)
                terms += written.terms
            continue
        for j, column in enumerate(candidate.columns):
            sigma = float(np.sqrt(max(last.inverse[span.start + j, span.start + j], 0.0)))
            largest = max((abs(term.coefficient) for term in column.terms), default=0.0)
            for term in column.terms:
                if abs(term.coefficient) <= NEGLIGIBLE * largest:
                    continue
                amplitude = term.coefficient * float(values[j])
                if not term.basis:
                    constants[names.index(term.parameter)] += amplitude
                    _add_move(rows, term.parameter, span.start + j, term.coefficient, last)
                    continue
                row = np.zeros(len(last.solution))
                row[span.start + j] = term.coefficient
                rows.append((f"term {len(terms)}", row))
                terms.append(
                    Term(
                        parameter=term.parameter,
                        basis=term.basis,
                        coefficient=amplitude,
                        standard_uncertainty=abs(term.coefficient) * sigma,
                        effect=label,
                    )
                )
    grown = _make_growth_term(last, arm) if growth else None
    if grown is not None:
        row = np.zeros(len(last.solution))
        row[last.layout.mount] = 1.0
        rows.append((f"term {len(terms)}", row))
        terms.append(grown)
    matrix = np.array([row for _, row in rows]).reshape(len(rows), len(last.solution))
    covariance = matrix @ last.inverse @ matrix.T
    return calibration.model_copy(
        update={
            "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            "constants": name_constants(constants, arm.n_joints),
            "terms": terms,
            "covariance_of": [name for name, _ in rows],
            "covariance": ((covariance + covariance.T) / 2).tolist(),
            "artefact": _correct_artefact(last, sessions),
            "provenance": _make_provenance(last, sessions, command, left_out),
            "content_sha256": "",
        }
    )


def _make_growth_term(last: Fit, arm: Arm) -> Term | None:
    """Make the term of the first link's expansion; None if it has none."""
    term = make_mount_term(last.model, arm)
    if term is None:
        return None
    index = last.layout.mount.start
    value, sigma = (
        -float(last.solution[index]),
        float(np.sqrt(max(last.inverse[index, index], 0.0))),
    )
    return term.model_copy(update={"coefficient": value, "standard_uncertainty": sigma})


def has_known_growth(last: Fit, arm: Arm) -> bool:
    """Whether a ramp of temperature determined the first link's expansion well."""
    term = _make_growth_term(last, arm)
    return term is not None and (
        0.0 < GROWTH_KNOWN * (term.standard_uncertainty or 0.0) < abs(term.coefficient)
    )


def _make_identified_rows(last: Fit, names: list[str]) -> list[tuple[str, F64]]:
    baseline = last.baseline
    identified = [names[i] for i in baseline.parameters] + [f"term {i}" for i in baseline.terms]
    span = last.layout.identified
    rows = []
    for i, name in enumerate(identified):
        row = np.zeros(len(last.solution))
        row[span] = baseline.root[i] if baseline.is_given else np.eye(span.stop - span.start)[i]
        rows.append((name, row))
    return rows


def _add_move(
    rows: list[tuple[str, F64]], parameter: str, index: int, coefficient: float, last: Fit
) -> None:
    """Add to a constant's row the shift by a finding: the constant is known only as well as the
    shift.
    """
    for name, row in rows:
        if name == parameter:
            row[index] += coefficient
            return
    row = np.zeros(len(last.solution))
    row[index] = coefficient
    rows.append((parameter, row))


def _correct_artefact(last: Fit, sessions: Sequence[Session]) -> ArtefactCorrection | None:
    """Return the artefact's correction: the one given, and what was found."""
    before = last.baseline.model.artefact
    expansion, scale = before.expansion_per_k, before.scale
    offsets = {name: np.array(offset) for name, offset in before.target_offset_mm.items()}
    certified = {s.artefact.name: s.artefact.expansion_per_k for s in sessions}
    names = set(certified)
    has_change = False
    for candidate, values in zip(last.findings, last.amplitudes, strict=True):
        for column, value in zip(candidate.columns, values, strict=True):
            change = column.artefact
            if change is None or change.is_report_only or change.kind == "distance":
                continue
            has_change = True
            if change.artefact:
                names &= {change.artefact}
            if change.kind == "expansion":
                certified_expansion = certified[change.artefact or sessions[0].artefact.name]
                expansion = (certified_expansion if expansion is None else expansion) + float(value)
            elif change.kind == "scale":
                scale *= 1.0 + float(value)
            else:
                offset = offsets.setdefault(change.target, np.zeros(3))
                offset[change.axis] += float(value)
    if not has_change:
        return last.baseline.calibration.artefact
    return ArtefactCorrection(
        artefacts=sorted(names),
        expansion_per_k=expansion,
        target_offset_mm={
            name: (float(o[0]), float(o[1]), float(o[2])) for name, o in offsets.items()
        },
        scale=scale,
    )


def _make_provenance(
    last: Fit, sessions: Sequence[Session], command: str, left_out: Sequence[Candidate]
) -> dict[str, Any]:
    before = last.baseline.calibration.provenance
    diagnosis: dict[str, Any] = {
        "command": command,
        "version": __version__,
        "sessions": [{"name": s.name, "sha256": s.fingerprint()} for s in sessions],
        "findings": [f"{c.cause} {c.location}" for c in last.findings],
        "not_borne_out": [f"{c.cause} {c.location}" for c in left_out],
    }
    if "diagnosis" in before:  # the model under test was itself an extended one
        diagnosis["earlier"] = before["diagnosis"]
    return {**before, "diagnosis": diagnosis}
