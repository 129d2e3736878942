"""Which measurements a later calibration moves, and by how much at most: for the quality file."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armd import __version__
from armd.compensation.report.drawing import one_drawing
from armd.compensation.report.page import Page

F64 = npt.NDArray[np.float64]
MOST_ROWS = 200


@dataclass(frozen=True)
class Change:
    """What recorrecting n measurements came to."""

    serial: str
    calibration_sha256: str
    stamp_ns: Sequence[int]
    distance_mm: F64  # (n,) NaN where the old or the new position is not known
    uncertainty_mm: F64  # (n,) of the new positions, standard, 3-D; NaN where not known
    tolerance_mm: float | None

    @property
    def matter(self) -> npt.NDArray[np.int64]:
        """Rows that move by more than the tolerance, the farthest first."""
        limit = np.inf if self.tolerance_mm is None else self.tolerance_mm
        rows = np.flatnonzero(self.distance_mm > limit)
        order: npt.NDArray[np.int64] = rows[np.argsort(-self.distance_mm[rows])]
        return order

    def in_words(self) -> str:
        """One sentence for the console and the page."""
        known = self.distance_mm[np.isfinite(self.distance_mm)]
        words = [f"{len(self.distance_mm)} measurements"]
        if len(known):
            rms = float(np.sqrt(np.mean(known**2)))
            words.append(f"moved by {rms:.4f} mm RMS, at most {known.max():.4f} mm")
        if (unknown := len(self.distance_mm) - len(known)) > 0:
            words.append(f"{unknown} without an old or a new position")
        if self.tolerance_mm is not None:
            words.append(f"{len(self.matter)} by more than {self.tolerance_mm:g} mm")
        return ", ".join(words)


def quality_page(change: Change, sources: Sequence[str]) -> str:
    """The page: what, from what, a curve over time, and the measurements that matter."""
    page = Page(f"Measurements corrected again: {change.serial}")
    page.text(f"{change.in_words()}.")
    now = datetime.datetime.now(datetime.UTC)
    page.items(
        [
            f"made {now:%Y-%m-%d %H:%M} UTC by armd {__version__}",
            f"calibration {change.calibration_sha256}",
            *(f"measurements from {name}" for name in sources),
            "tolerance not stated" if change.tolerance_mm is None
            else f"tolerance {change.tolerance_mm:g} mm",
        ]
    )  # fmt: skip
    instants = [datetime.datetime.fromtimestamp(s * 1e-9, datetime.UTC) for s in change.stamp_ns]
    figure, panel = one_drawing()
    panel.plot(
        np.array(change.stamp_ns, dtype="datetime64[ns]"),
        change.distance_mm,
        "o",
        markersize=3,
        rasterized=True,
    )
    panel.set(xlabel="measured at, UTC", ylabel="distance between old and new position, mm")
    panel.set_ylim(bottom=0.0)
    if change.tolerance_mm is not None:
        panel.axhline(change.tolerance_mm, linestyle="--", color="black", label="tolerance")
        panel.legend(frameon=False)
    page.figure(figure, "How far each measurement moves, mm, over when it was taken")
    if change.tolerance_mm is not None:
        rows = change.matter
        page.heading(f"Measurements that move by more than {change.tolerance_mm:g} mm")
        page.table(
            ["measured at, UTC", "moved by mm", "standard uncertainty of the new position mm"],
            [
                [
                    f"{instants[i]:%Y-%m-%d %H:%M:%S}",
                    f"{change.distance_mm[i]:.4f}",
                    _number(change.uncertainty_mm[i]),
                ]
                for i in rows[:MOST_ROWS]
            ],
        )
        if len(rows) > MOST_ROWS:
            page.text(f"The farthest {MOST_ROWS} of {len(rows)}; all are in the CSV.")
    return page.html()


def _number(value: float) -> str:
    return "not stated" if np.isnan(value) else f"{value:.4f}"
