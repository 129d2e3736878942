"""Tables of a calibration: lengths, parameters, combinations that are not
identifiable, outliers.
"""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.compensation.estimate.unknowns import describe_term
from armd.compensation.identify.fit import Identification
from armd.compensation.identify.result import Result
from armd.compensation.model import parameters
from armd.compensation.model.terms import Term
from armd.compensation.report.layout.page import Page
from armd.compensation.report.layout.units import Unit, Units
from armd.compensation.report.sessions import NOT_STATED
from armd.terminal.counted import format_count

#: Correlations stronger than this are listed.
WORTH_KNOWING = 0.9
#: The most outliers in a table; the result's JSON has all.
MOST_LISTED = 50
#: A constant whose share in every direction that is not identifiable is below this is determined by
#: itself.
ALONE = 1e-3


def add_lengths(page: Page, result: Result, unit: Unit) -> None:
    """Add the certified lengths as the calibrated arm measures them."""
    if not result.lengths:
        return
    page.add_heading("Certified lengths")
    page.add_text("Between the seats as the calibrated arm finds them, the lengths taking no part.")
    page.add_table(
        ["length", "certified, mm", "u, mm", "measured, mm", "u of the seats, mm",
         f"error, {unit.name}", "in standard uncertainties"],
        [
            [
                " to ".join(length.between), f"{length.certified_mm:.4f}",
                f"{length.standard_uncertainty_mm:.4f}", f"{length.measured_mm:.4f}",
                f"{length.measured_uncertainty_mm:.4f}", unit.format_value(length.error_mm, "+"),
                f"{length.off:+.2f}",
            ]
            for length in result.lengths
        ],
    )  # fmt: skip


def add_not_identifiable(page: Page, result: Result) -> None:
    """Add the combinations of parameters that these sessions do not determine."""
    page.add_heading("Not identifiable from these sessions")
    page.add_text(
        "The drawing counts as one more reading of these combinations, good to a plausible"
        " departure, and their uncertainty says so; what moves no point has none."
    )
    page.add_items(result.unidentifiable)


def add_parameters_and_terms(page: Page, result: Result, units: Units) -> None:
    """Add each constant and term with its standard uncertainty."""
    fit = result.fit
    arm = fit.observations.arm
    nominal = dict(zip(arm.layout.names, arm.nominal().tolist(), strict=True))
    identified = result.calibration.constants
    deviation = dict(
        zip(fit.unknowns.names, np.sqrt(np.diag(fit.covariance)).tolist(), strict=True)
    )
    unknown = dict(zip(fit.unknowns.names, _compute_null_share(fit), strict=True))
    rows, faint = [], []
    for name in fit.unknowns.constants:
        angle = parameters.find_unit(name) == "rad"
        factor, kind = (np.degrees(1.0), "°") if angle else (1.0, "mm")
        small = units.angle if angle else units.length
        difference, sigma = identified[name] - nominal[name], deviation[name]
        faint.append(unknown[name] >= ALONE)
        rows.append(
            [
                name, f"{nominal[name] * factor:.5f} {kind}",
                f"{identified[name] * factor:.5f} {kind}",
                f"{small.format_value(difference, '+')} {small.name}",
                f"{small.format_value(sigma)} {small.name}",
                "only in combination" if faint[-1] else _format_ratio(difference, sigma),
            ]
        )  # fmt: skip
    page.add_heading("Parameters")
    page.add_table(
        ["constant", "drawing", "identified", "difference", "standard uncertainty",
         "difference / uncertainty"],
        rows,
        faint,
    )  # fmt: skip
    if any(faint):
        page.add_text("Grey: known only in combination with others, as listed above.")
    if fit.terms:
        page.add_table(
            ["term", "coefficient", "standard uncertainty", "unit"],
            [
                [
                    describe_term(term), f"{term.coefficient:.4g}",
                    _format_uncertainty(term),
                    f"{parameters.find_unit(term.parameter)} per unit of its basis",
                ]
                for term in fit.terms
            ],
        )  # fmt: skip


def _format_ratio(difference: float, sigma: float) -> str:
    return f"{difference / sigma:+.1f}" if sigma > 0.0 else NOT_STATED


def _compute_null_share(fit: Identification) -> F64:
    """Return the largest share (C,) of each unknown in a direction that nothing determines."""
    share: F64 = np.abs(fit.solution.null).max(axis=1, initial=0.0)
    return share


def _format_uncertainty(term: Term) -> str:
    uncertainty = term.standard_uncertainty
    return NOT_STATED if uncertainty is None else f"{uncertainty:.2g}"


def add_correlations(page: Page, fit: Identification) -> None:
    """Add the pairs of determined unknowns that are strongly correlated."""
    deviation = np.sqrt(np.diag(fit.covariance))
    safe = np.where(deviation > 0, deviation, np.inf)
    correlation = fit.covariance / np.outer(safe, safe)
    determined = _compute_null_share(fit) < ALONE
    names = fit.unknowns.words(fit.terms)
    pairs = [
        (abs(correlation[i, j]), names[i], names[j], f"{correlation[i, j]:+.3f}")
        for i in range(len(names))
        for j in range(i)
        if determined[i] and determined[j] and abs(correlation[i, j]) > WORTH_KNOWING
    ]
    page.add_heading("Correlations worth knowing")
    if not determined.all():
        page.add_text(
            f"Not determined, and so not listed: correlations of the"
            f" {format_count(int((~determined).sum()), 'unknown')} known only in combination."
        )
    if not pairs:
        page.add_text(f"None beyond ±{WORTH_KNOWING}.")
        return
    page.add_table(["", "with", "correlation"], [pair[1:] for pair in sorted(pairs)[::-1][:20]])


def add_thermal_trials(page: Page, result: Result, unit: Unit) -> None:
    """Add the held-out error of each thermal model."""
    if not result.trials:
        return
    page.add_heading("Thermal models compared")
    page.add_text(
        "Each fitted without one set of readings and tried on it, in turn: every temperature, the"
        " lowest and the highest in parts, so that something of them stays; 3-D RMS over all."
    )
    page.add_table(
        ["model", f"held out, {unit.name}", f"without down-weighted readings, {unit.name}"],
        [
            [
                trial.name,
                unit.format_value(trial.errors.rms_um / 1e3),
                unit.format_value(trial.errors.without_down_weighted_um / 1e3),
            ]
            for trial in result.trials
        ],
    )


def add_outliers(page: Page, result: Result, unit: Unit) -> None:
    """Add the outliers and the number of down-weighted readings."""
    listed = result.outliers()
    page.add_heading("Outliers")
    page.add_text(
        f"Down-weighted readings: {len(result.fit.down_weighted)}. Each lies farther off than one"
        " Gaussian reading in 10 000; its weight falls with the square of its distance. Outliers:"
        f" {len(listed)}. The tails of the noise do not explain them."
        + f" The first {MOST_LISTED} are listed."
        * (len(listed) > MOST_LISTED)
    )
    if listed:
        page.add_table(
            ["session", "row", f"residual, {unit.name}", "standard deviations"],
            [
                [
                    o["session"],
                    o["row"],
                    unit.format_value(o["error_um"] / 1e3),
                    f"{o['sigma']:.1f}",
                ]
                for o in listed[:MOST_LISTED]
            ],
        )
