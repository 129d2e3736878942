"""A check whether a cause explains what it is named for: its share, and predictive checks.

An arm may err in a way that is in no catalogue. The search then accepts the nearest named
cause, although it explains little, and the residual still varies with that cause's own variables.
Two questions decide. Is the cause's amplitude equal in every session, placement, part of the time
and part of its variables' ranges? How much do functions without a name explain in these variables
in addition to the cause? The share is explained / (explained + unexplained), where unexplained is
the larger answer of the two.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np
from scipy.special import chdtrc

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import ALPHA, LEAST_PART_SHOWN, MOST_PARTS, RANGE_PARTS
from armd.compensation.diagnose.diagnosis import Explained, PartCheck
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.scoring.evidence import Scores
from armd.compensation.diagnose.scoring.shape import is_shape, locate_shape
from armd.compensation.diagnose.scoring.threshold import is_significant
from armd.compensation.effects.effect import Candidate


def compute_explained_shares(
    last: Fit, statistics: Sequence[float], scores: Scores, tests: int
) -> list[Explained]:
    """Return the share, variables and checks of each finding of a fit.

    *statistics*: what each finding explains (χ²), given the others. *scores* are those of all
    candidates, with the findings in the model.
    """
    every = [_checks(last, i) for i in range(len(last.findings))]
    count = max(sum(len(checks) for checks in every), 1)
    explanations = []
    for i, (candidate, checks) in enumerate(zip(last.findings, every, strict=True)):
        varies = max((c.excess for c in checks if c.p_value < ALPHA / count), default=0.0)
        unnamed, variables = _explained_beside(candidate, last.findings, statistics, scores, tests)
        explained = max(statistics[i] - len(candidate.columns), 0.0)
        unexplained = max(varies, unnamed)
        share = explained / (explained + unexplained) if unexplained > 0.0 else 1.0
        explanations.append(Explained(share, variables, checks))
    return explanations


def _explained_beside(
    candidate: Candidate,
    findings: Sequence[Candidate],
    statistics: Sequence[float],
    scores: Scores,
    tests: int,
) -> tuple[float, tuple[str, ...]]:
    """Return what unnamed functions explain (χ²) in a cause's variables in addition to it.

    The sum counts such functions whether they are findings or only candidates. It also counts
    findings with the cause's name and place in other variables. All variables concerned are
    returned with it.
    """
    variables = set(candidate.depends_on)
    names = dict.fromkeys(candidate.depends_on)
    if candidate.cause == "unknown" or not variables:
        return 0.0, tuple(names)
    total = 0.0
    for rival, statistic in zip(findings, statistics, strict=True):
        if rival is not candidate and _explains_part_of_name(candidate, rival):
            total += max(statistic - len(rival.columns), 0.0)
            names.update(dict.fromkeys(rival.depends_on))
    unnamed = [
        (float(scores.statistic[i] - scores.freedom[i]), rival)
        for i, rival in enumerate(scores.signatures.candidates)
        if rival.cause == "unknown"
        and variables & set(rival.depends_on)
        and _may_count_against(candidate, rival)
        and is_significant(scores.log_p[i], tests)
    ]
    if unnamed:
        excess, rival = max(unnamed, key=lambda pair: pair[0])
        total += excess
        names.update(dict.fromkeys(rival.depends_on))
    return total, tuple(names)


def _explains_part_of_name(candidate: Candidate, finding: Candidate) -> bool:
    """Whether a finding explains something that the cause would explain if its name were right.

    This holds of a form error, and of several causes with one name and place in some of the
    variables: an error that depends on two angles in a form without a name looks like several
    causes.
    """
    variables, finding_variables = set(candidate.depends_on), set(finding.depends_on)
    if is_shape(finding):
        return finding.location == locate_shape(candidate)
    if finding.cause == "unknown":
        return bool(list_variables(finding) & variables) and _may_count_against(candidate, finding)
    return (
        finding.place == candidate.place
        and bool(finding_variables & variables)
        and finding_variables != variables
    )


def _may_count_against(candidate: Candidate, unknown: Candidate) -> bool:
    """Whether an *unknown* structure moves the same joint as a cause; True unless it looks back.

    What happened before a reading contains the joint's angle and the time. It is no evidence
    against causes elsewhere that depend on these variables, too.
    """
    return not unknown.looks_back or unknown.location.joint == candidate.location.joint


def list_variables(unknown: Candidate) -> set[str]:
    """Return the variables of an unknown structure, with the angle of the joint that it moves."""
    location = unknown.location
    return {*unknown.depends_on, *([f"q{location.joint}"] if location.kind == "parameter" else [])}


def _checks(last: Fit, index: int) -> tuple[PartCheck, ...]:
    n = last.linear.rests.n
    moves = last.net_signature(index)
    signature = last.noise.whiten_rests(moves)
    residual = (last.residual - last.fitted)[: 3 * n].reshape(n, 3)
    white = last.noise.whiten_rests(residual)
    squared_norms = (signature**2).sum(axis=1)
    products = (signature * white).sum(axis=1)
    if not squared_norms.sum() > 0.0:
        return ()
    checks = []
    for by, labels, names in _partitions(last, last.findings[index]):
        size = np.bincount(labels, squared_norms, len(names))
        shown_parts = np.flatnonzero(size > LEAST_PART_SHOWN * squared_norms.sum())
        if len(shown_parts) < 2:
            continue
        change = np.bincount(labels, products, len(names))[shown_parts] / size[shown_parts]
        chi_square = float((change**2 * size[shown_parts]).sum())
        freedom = len(shown_parts) - 1
        checks.append(
            PartCheck(
                by,
                tuple(names[k] for k in shown_parts),
                1.0 + change,
                1.0 / np.sqrt(size[shown_parts]),
                float(chdtrc(freedom, chi_square)),
                max(chi_square - freedom, 0.0),
            )
        )
    return tuple(checks)


def _partitions(last: Fit, candidate: Candidate) -> Iterator[tuple[str, I64, list[str]]]:
    """Yield ways to split the rests: the variable, the part of each rest (n,), the parts' names."""
    rests = last.linear.rests
    observations = rests.observations
    sessions = list(observations.session_names)
    if 1 < len(sessions) <= MOST_PARTS:
        yield "session", observations.session, sessions
    placements = list(observations.placement_names)
    if len(sessions) < len(placements) <= MOST_PARTS:
        yield "placement", observations.placement, placements
    states = observations.states
    columns: dict[str, F64] = {}
    if np.isfinite(states.time_s).all():
        columns["time_s"] = states.time_s - states.time_s.min()
    for name in candidate.depends_on:
        if match := re.fullmatch(r"([qw])(\d+)", name):
            values = states.q if match[1] == "q" else states.rate
            columns[name] = values[:, int(match[2]) - 1]
        elif name in observations.arm.sensors:
            columns[name] = states.temperature_c[:, observations.arm.sensors.index(name)]
        elif name == "artefact_c":
            columns[name] = rests.artefact_rise_c
    for name, values in columns.items():
        if np.isfinite(values).all() and np.ptp(values) > 0.0:
            order = np.argsort(np.argsort(values, kind="stable"), kind="stable")
            labels = order * RANGE_PARTS // len(order)
            yield name, labels, [_range(values[labels == k]) for k in range(labels.max() + 1)]


def _range(values: F64) -> str:
    return f"{values.min():.4g} to {values.max():.4g}" if len(values) else ""
