"""The quality file's page: which measurements a later calibration moves, and their
largest error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, Mask
from armd.compensation.report.layout.drawing import make_single_figure
from armd.compensation.report.layout.page import Page, make_report_number
from armd.compensation.report.sessions import NOT_STATED
from armd.terminal.counted import format_count

MOST_ROWS = 200
#: Two-sided 95 % quantile of a normal distribution. A spatial error whose three variances add up to
#: s² exceeds 1.96 s with a probability of at most 5 %. The maximum occurs if all variance is in one
#: direction.
AT_95 = 1.96


@dataclass(frozen=True)
class Impact:
    """The result of recorrecting n measurements."""

    serial: str
    calibration_sha256: str
    seq: Sequence[int]
    stamp_ns: Sequence[int]
    distance_mm: F64  # (n,) NaN where the old or the new position is not known
    uncertainty_mm: F64  # (n,) of the new positions, standard, 3-D; NaN where not known
    tolerance_mm: float | None
    calibrations_before: Sequence[str | None] = ()  # (n,) first digits of their old calibrations

    @property
    def at_most_mm(self) -> F64:
        """The 95 % upper limit of the old positions' errors (n,); NaN where it is unknown."""
        bound: F64 = self.distance_mm + AT_95 * self.uncertainty_mm
        return bound

    @property
    def matter(self) -> Mask:
        """A mask (n,) of the measurements that move by more than the tolerance."""
        beyond: Mask = self.distance_mm > self._limit_mm
        return beyond

    @property
    def may_matter(self) -> Mask:
        """A mask (n,) of those that move by less, but may have been off by more."""
        beyond: Mask = ~self.matter & (self.at_most_mm > self._limit_mm)
        return beyond

    @property
    def _limit_mm(self) -> float:
        return np.inf if self.tolerance_mm is None else self.tolerance_mm

    def headline(self) -> tuple[str, bool | None]:
        """Return the result in a few words, and whether it is good; None if it is not judged."""
        count = len(self.distance_mm)
        if self.tolerance_mm is None:
            return "NOT JUDGED: NO TOLERANCE", None
        if affected := int(self.matter.sum()):
            return f"{affected} OF {format_count(count, 'measurement').upper()} AFFECTED", False
        if doubtful := int(self.may_matter.sum()):
            return (
                f"{doubtful} OF {format_count(count, 'measurement').upper()} MAY BE AFFECTED",
                False,
            )
        # A measurement without an uncertainty is not known to have been within the tolerance.
        has_uncertainties = bool(np.isfinite(self.at_most_mm).all())
        return (
            f"NONE OF {format_count(count, 'measurement').upper()} AFFECTED",
            True if has_uncertainties and count else None,
        )

    def in_words(self) -> str:
        """Describe the result in one sentence for the console and the page."""
        distances_mm = self.distance_mm[np.isfinite(self.distance_mm)]
        words = [format_count(len(self.distance_mm), "measurement")]
        if len(distances_mm):
            rms = float(np.sqrt(np.mean(distances_mm**2)))
            words.append(f"moved by {rms:.4f} mm RMS, at most {distances_mm.max():.4f} mm")
        if (unknown := len(self.distance_mm) - len(distances_mm)) > 0:
            words.append(f"{unknown} without an old or a new position")
        if np.isfinite(self.at_most_mm).any():
            words.append(f"off by at most {np.nanmax(self.at_most_mm):.4f} mm (95 %)")
        if self.tolerance_mm is not None:
            words.append(f"{self.matter.sum()} by more than {self.tolerance_mm:g} mm")
            if self.may_matter.any():
                words.append(f"{self.may_matter.sum()} more possibly")
        return ", ".join(words)


def render_quality_page(
    change: Impact,
    inputs: Mapping[str, str],
    left_out: Sequence[str],
    operator: str | None,
    celsius: Sequence[float],
) -> str:
    """Render the page as HTML text.

    *inputs* are names and their SHA-256, *left_out* sentences. *operator* is the person who
    corrects again (None: not stated). *celsius* are the arm's temperatures in the measurements.
    """
    page = Page(f"Measurements corrected again: {change.serial}")
    word, good = change.headline()
    page.add_verdict(word, f"{change.in_words()}.", good)
    page.add_items(left_out)
    page.add_text(
        "Off by at most: how far a measurement moves, and 1.96 times the standard uncertainty of "
        "its new position, in space; with a probability of 95 % its old position was no farther "
        "off, as far as the calibration states its uncertainty."
    )
    page.add_text(f"Decision rule: {_write_rule(change.tolerance_mm)}.")
    figure, panel = make_single_figure()
    instants = np.array(change.stamp_ns, dtype="datetime64[ns]")
    panel.plot(instants, change.distance_mm, "o", markersize=3, rasterized=True, label="moved by")
    panel.plot(
        instants, change.at_most_mm, "_", color="black", rasterized=True, label="off by at most"
    )
    panel.set(xlabel="measured at, UTC", ylabel="error of the old position, mm")
    panel.set_ylim(bottom=0.0)
    if change.tolerance_mm is not None:
        panel.axhline(change.tolerance_mm, linestyle="--", color="black", label="tolerance")
    panel.legend(frameon=False)
    page.add_figure(figure, "How far each measurement moves, and how far it was off at most, mm")
    _add_affected(page, change)
    tolerance = change.tolerance_mm
    before = sorted({sha256 or "none" for sha256 in change.calibrations_before})
    facts = {
        "arm": change.serial,
        "operator": operator or NOT_STATED,
        "temperatures of the arm while measuring": (
            f"{min(celsius):.1f} to {max(celsius):.1f} °C" if celsius else "not measured"
        ),
        "calibration": change.calibration_sha256,
        "measured under (calibration's first digits)": ", ".join(before) or "nothing",
        "tolerance": NOT_STATED if tolerance is None else f"{tolerance:g} mm",
    }
    page.add_origin(make_report_number(change.serial, *inputs.values()), inputs, facts)
    page.add_signature_lines("Corrected again by", "Checked by")
    return page.to_html()


def _write_rule(tolerance_mm: float | None) -> str:
    if tolerance_mm is None:
        return "none, as no tolerance was given (--tolerance)"
    return (
        f"a measurement is affected if it moves by more than the tolerance, {tolerance_mm:g} mm,"
        " and possibly affected if it may have been off by more"
    )


def _add_affected(page: Page, change: Impact) -> None:
    """Add a table of the measurements that are or may be affected, the worst first.

    Without a tolerance it lists all measurements with an old and a new position.
    """
    if change.tolerance_mm is None:
        page.add_heading("Measurements affected")
        rows = np.flatnonzero(np.isfinite(change.distance_mm))
    else:
        page.add_heading(
            f"Measurements that move by more than {change.tolerance_mm:g} mm, or may be off by more"
        )
        rows = np.flatnonzero(change.matter | change.may_matter)
    rows = rows[np.argsort(-change.distance_mm[rows], kind="stable")]
    if not len(rows):
        page.add_text("None.")
        return
    page.add_table(
        ["seq", "measured at, UTC", "moved by, mm", "standard uncertainty, mm",
         "off by at most (95 %), mm"],
        [
            [
                str(change.seq[i]),
                f"{np.datetime64(change.stamp_ns[i], 'ns').astype('datetime64[s]')}",
                f"{change.distance_mm[i]:.4f}",
                _format_number(change.uncertainty_mm[i]),
                _format_number(change.at_most_mm[i]),
            ]
            for i in rows[:MOST_ROWS]
        ],
    )  # fmt: skip
    if len(rows) > MOST_ROWS:
        page.add_text(f"The farthest {MOST_ROWS} of {len(rows)}; all are in the CSV.")


def _format_number(value: float) -> str:
    return NOT_STATED if np.isnan(value) else f"{value:.4f}"
