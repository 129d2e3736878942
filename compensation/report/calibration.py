"""The report of `armd calibrate`: what an auditor asks, on one page."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.ticker import LogFormatter

from armd.arrays import F64, I64
from armd.compensation.data.session import Session
from armd.compensation.estimate.unknowns import in_words
from armd.compensation.identify.certificate import RULE
from armd.compensation.identify.evaluation.evaluate import evaluate_model
from armd.compensation.identify.fit import Identification
from armd.compensation.identify.result import Result
from armd.compensation.identify.thermal.temperatures import temperature_groups
from armd.compensation.model import parameters
from armd.compensation.model.calibration import LoadedCalibration
from armd.compensation.model.terms import Term
from armd.compensation.report.drawing import MOST_POINTS, cloud, drawing, one_drawing, views
from armd.compensation.report.page import Page
from armd.compensation.report.sessions import NOT_STATED, InputFile, origin
from armd.terminal.counted import counted

#: Correlations stronger than this are worth knowing.
WORTH_KNOWING = 0.9
#: Outliers in a table; the result's JSON has all.
MOST_LISTED = 50
#: A constant with less than this share in every direction not identifiable stands alone.
ALONE = 1e-3


def calibration_report(
    result: Result, sessions: Sequence[Session], arm_file: InputFile, written: LoadedCalibration
) -> str:
    """The whole HTML file; *written* is the calibration as it stands on the disk."""
    arm = result.fit.observations.arm
    page = Page(f"Calibration of {arm.serial_number}")
    _summary(page, result)
    _before_and_after(page, result)
    _residual_vectors(page, result.fit)
    _residuals_by_column(page, result.fit)
    _parameters(page, result)
    _correlations(page, result.fit)
    _thermal_trials(page, result)
    _outliers(page, result)
    _provenance(page, result, sessions, arm_file, written)
    return page.html()


def _summary(page: Page, result: Result) -> None:
    found, noise, record = result.fit, result.fit.noise, result.certificate
    good = (True if record.scale_known else None) if record.granted else False
    page.verdict(record.word.upper(), f"{record.kind}: {record.why_and_next()}", good)
    page.text(f"Decision rule: {RULE}.")
    page.table(
        ["", "value", "unit"],
        [
            ["residual, 3-D RMS", f"{result.rms_um:.2f}", "µm"],
            [
                f"{result.left_out_in_words} left out in turn, 3-D RMS",
                result.heldout.in_words(),
                "",
            ],
            ["readings", found.observations.n, ""],
            ["placements", len(np.unique(found.observations.placement)), ""],
            ["rank", f"{found.solution.rank} of {len(found.unknowns.names)} unknowns", ""],
            ["noise of an encoder", f"{np.degrees(noise.encoder_rad) * 3600:.3f}", "″"],
            ["noise of a reading, per axis", f"{1e3 * noise.reading_mm:.3f}", "µm"],
            ["thermal order", result.thermal_order, ""],
        ],
    )
    if result.notes:
        page.items(result.notes)
    if result.lengths:
        page.heading("Certified lengths")
        page.text("Between the seats as the calibrated arm finds them, the lengths taking no part.")
        page.table(
            ["length", "certified mm", "u mm", "measured mm", "u of the seats mm", "error µm",
             "in standard uncertainties"],
            [
                [
                    " to ".join(length.between), f"{length.certified_mm:.4f}",
                    f"{length.standard_uncertainty_mm:.4f}", f"{length.measured_mm:.4f}",
                    f"{length.measured_uncertainty_mm:.4f}", f"{1e3 * length.error_mm:+.1f}",
                    f"{length.off:+.2f}",
                ]
                for length in result.lengths
            ],
        )  # fmt: skip
    page.heading("Not identifiable from these sessions")
    page.text(
        "The drawing counts as one more reading of these combinations, good to a plausible"
        " departure, and their uncertainty says so; what moves no point has none."
    )
    page.items(result.unidentifiable)


def _before_and_after(page: Page, result: Result) -> None:
    found = result.fit
    observations, arm = found.observations, found.observations.arm
    groups = temperature_groups(observations) or [(np.nan, np.ones(observations.n, dtype=bool))]
    models = {"as drawn": (arm.nominal(), []), "identified": (found.constants, found.terms)}
    if found.terms:
        models["identified, at the reference temperature"] = (found.constants, [])
        models["identified, with temperature"] = models.pop("identified")
    figure, panel = one_drawing()
    rows = []
    labels = [f"{mean:.1f} °C" if np.isfinite(mean) else "all" for mean, _ in groups]
    wide = 0.8 / len(models)
    for i, (name, (constants, terms)) in enumerate(models.items()):
        residual = evaluate_model(observations, constants, terms, found.reference_c)
        distance = residual.distance_um
        rms = [float(np.sqrt(np.mean(distance[mask] ** 2))) for _, mask in groups]
        panel.bar(np.arange(len(rms)) + i * wide, rms, wide, label=name)
        for label, (_, mask), value in zip(labels, groups, rms, strict=True):
            rows.append(
                [name, label, f"{value:.2f}", f"{np.median(distance[mask]):.2f}",
                 f"{distance[mask].max():.2f}"]
            )  # fmt: skip
    panel.set_xticks(np.arange(len(labels)) + wide * (len(models) - 1) / 2, labels)
    panel.set(yscale="log", ylabel="3-D RMS, µm", xlabel="temperature of the arm")
    panel.yaxis.set_major_formatter(LogFormatter())  # the usual one writes TeX
    panel.yaxis.set_minor_formatter(LogFormatter())
    panel.legend(loc="upper center", bbox_to_anchor=(0.5, 1.15), ncols=len(models), frameon=False)
    page.heading("Before and after, by temperature")
    page.figure(figure, "3-D RMS of the readings used, µm, by model and temperature")
    page.table(["model", "temperature", "RMS µm", "median µm", "maximum µm"], rows)


def _residual_vectors(page: Page, found: Identification) -> None:
    rows = _some(found.observations.n)
    tip, residual = found.at.position_mm[rows], found.at.residual_mm[rows]
    size = float(np.median(np.linalg.norm(residual, axis=1))) or 1.0
    reach = float(np.linalg.norm(np.ptp(tip, axis=0)))
    times = 10 ** np.floor(np.log10(0.03 * reach / size))
    ends = np.stack([tip, tip + times * residual, np.full_like(tip, np.nan)], axis=1)
    lines = ends.reshape(-1, 3)
    figure, panels = views()
    for panel, across, up in panels:
        panel.plot(lines[:, across], lines[:, up], linewidth=0.8, rasterized=True)
    page.heading("Residual vectors")
    page.figure(
        figure,
        f"At each tip position of the base frame its residual, drawn {times:g} times as long",
    )


def _residuals_by_column(page: Page, found: Identification) -> None:
    observations = found.observations
    states, arm = observations.states, observations.arm
    columns = [(f"q{k + 1}, °", np.degrees(states.q[:, k])) for k in range(arm.n_joints)]
    columns += [
        (f"{name}, °C", states.temperature_c[:, s])
        for s, name in enumerate(arm.sensors)
        if np.isfinite(states.temperature_c[:, s]).any()
    ]
    rows = _some(observations.n)
    distance = 1e3 * np.linalg.norm(found.at.residual_mm, axis=1)
    lines = -(-len(columns) // 3)
    figure, axes = drawing(lines, 3, height_in=2.2 * lines)
    for i, (title, values) in enumerate(columns):
        panel = axes[i]
        cloud(panel, values[rows], distance[rows])
        panel.set(xlabel=title, ylabel="residual, µm" if i % 3 == 0 else "")
        panel.set_ylim(bottom=0.0)
    for panel in axes[len(columns) :]:
        panel.set_axis_off()
    page.heading("Residuals against each joint and each sensor")
    page.figure(figure, "3-D residual of each reading, µm, over each angle and each temperature")


def _parameters(page: Page, result: Result) -> None:
    found = result.fit
    arm = found.observations.arm
    nominal = dict(zip(arm.layout.names, arm.nominal().tolist(), strict=True))
    identified = result.calibration.constants
    deviation = dict(
        zip(found.unknowns.names, np.sqrt(np.diag(found.covariance)).tolist(), strict=True)
    )
    unknown = dict(zip(found.unknowns.names, _null_share(found), strict=True))
    rows = []
    for name in found.unknowns.constants:
        angle = parameters.unit(name) == "rad"
        factor, unit = (np.degrees(1.0), "°") if angle else (1.0, "mm")
        small, small_unit = (np.degrees(3600.0), "″") if angle else (1e3, "µm")
        known = "" if unknown[name] < ALONE else "only in combination"
        rows.append(
            [
                name, unit, f"{nominal[name] * factor:.5f}", f"{identified[name] * factor:.5f}",
                f"{(identified[name] - nominal[name]) * small:.2f} {small_unit}",
                f"{deviation[name] * small:.2f} {small_unit}", known,
            ]
        )  # fmt: skip
    page.heading("Parameters")
    page.table(
        ["constant", "unit", "drawing", "identified", "difference", "standard uncertainty", ""],
        rows,
    )
    if found.terms:
        page.table(
            ["term", "coefficient", "standard uncertainty", "unit"],
            [
                [
                    in_words(term), f"{term.coefficient:.4g}",
                    _uncertainty(term),
                    f"{parameters.unit(term.parameter)} per unit of its basis",
                ]
                for term in found.terms
            ],
        )  # fmt: skip


def _null_share(found: Identification) -> F64:
    """Return the largest share (C,) of each unknown in a direction that nothing determines."""
    share: F64 = np.abs(found.solution.null).max(axis=1, initial=0.0)
    return share


def _uncertainty(term: Term) -> str:
    known = term.standard_uncertainty
    return NOT_STATED if known is None else f"{known:.2g}"


def _correlations(page: Page, found: Identification) -> None:
    deviation = np.sqrt(np.diag(found.covariance))
    safe = np.where(deviation > 0, deviation, np.inf)
    correlation = found.covariance / np.outer(safe, safe)
    determined = _null_share(found) < ALONE
    names = found.unknowns.words(found.terms)
    pairs = [
        (abs(correlation[i, j]), names[i], names[j], f"{correlation[i, j]:+.3f}")
        for i in range(len(names))
        for j in range(i)
        if determined[i] and determined[j] and abs(correlation[i, j]) > WORTH_KNOWING
    ]
    page.heading("Correlations worth knowing")
    if not determined.all():
        page.text(
            f"Not determined, and so not listed: correlations of the"
            f" {counted(int((~determined).sum()), 'unknown')} known only in combination."
        )
    if not pairs:
        page.text(f"None beyond ±{WORTH_KNOWING}.")
        return
    page.table(["", "with", "correlation"], [pair[1:] for pair in sorted(pairs)[::-1][:20]])


def _thermal_trials(page: Page, result: Result) -> None:
    if not result.trials:
        return
    page.heading("Thermal models compared")
    page.text(
        "Each fitted without one set of readings and tried on it, in turn: every temperature, the"
        " lowest and the highest in parts, so that something of them stays; 3-D RMS over all."
    )
    page.table(
        ["model", "held out"],
        [[trial.name, trial.errors.in_words()] for trial in result.trials],
    )


def _outliers(page: Page, result: Result) -> None:
    listed = result.outliers()
    page.heading("Outliers")
    page.text(
        "Readings farther off than one Gaussian reading in 10 000 count with a weight that falls"
        f" with the square of their distance: {len(result.fit.weighed_down)}. Outliers are those"
        f" that the tails of the noise do not explain: {len(listed)}."
        + f" The first {MOST_LISTED} are listed."
        * (len(listed) > MOST_LISTED)
    )
    if listed:
        page.table(
            ["session", "row", "residual µm", "standard deviations"],
            [
                [o["session"], o["row"], f"{o['error_um']:.1f}", f"{o['sigma']:.1f}"]
                for o in listed[:MOST_LISTED]
            ],
        )


def _provenance(
    page: Page,
    result: Result,
    sessions: Sequence[Session],
    arm_file: InputFile,
    written: LoadedCalibration,
) -> None:
    provenance = result.calibration.provenance
    facts = {
        "calibration written": f"{written.path.name}, SHA-256 {written.sha256}",
        "command": f"{provenance['command']} (armd {provenance['version']})",
    }
    origin(page, result.fit.observations.arm, sessions, {"arm": arm_file}, facts)
    page.signatures("Calibrated by", "Checked by")


def _some(n: int) -> I64:
    """Rows to draw: all, or as many as a page bears, evenly spread."""
    return np.linspace(0, n - 1, min(n, MOST_POINTS)).astype(np.int64)
