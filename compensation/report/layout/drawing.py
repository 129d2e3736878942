"""Drawings of a report: one style for all, written as SVG elements of a page.

Lines and letters stay vectors, so that they print well. Clouds of readings become a bitmap within
the drawing (`draw_dots`), because thousands of them would make a page of megabytes.
"""

from __future__ import annotations

import html
import io
import re
from collections.abc import Sequence
from contextlib import AbstractContextManager

import matplotlib as mpl
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from armd.arrays import F64

#: Colours that colour-blind readers can separate, too (Okabe and Ito).
COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"]
#: More points than this do not make a picture clearer.
MOST_POINTS = 5000

WIDTH_IN = 9.0
DOTS_PER_INCH = 110  # of a bitmap


class NotebookFigure(Figure):
    """A figure that a notebook displays, whether or not it has loaded pyplot."""

    def _repr_png_(self) -> bytes:
        data = io.BytesIO()
        self.savefig(data, format="png", dpi=DOTS_PER_INCH)
        return data.getvalue()


def _use_style(salt: str = "") -> AbstractContextManager[None]:
    """Use the style of all drawings; *salt* makes the identifiers of one drawing's parts unique."""
    return mpl.rc_context(
        {
            "svg.fonttype": "none",
            "svg.hashsalt": salt,
            "font.family": ["sans-serif"],
            "font.size": 9.0,
            "text.parse_math": False,  # a dollar in a name is no formula
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.grid": True,
            "grid.color": "#d8dee4",
            "grid.linewidth": 0.6,
            "axes.axisbelow": True,
            "axes.prop_cycle": cycler(color=COLOURS),
        }
    )


def make_figure(
    rows: int = 1, columns: int = 1, height_in: float = 3.6
) -> tuple[Figure, list[Axes]]:
    """Make a figure as wide as the page, and its axes row by row."""
    with _use_style():
        figure = NotebookFigure(figsize=(WIDTH_IN, height_in), layout="constrained")
        return figure, list(figure.subplots(rows, columns, squeeze=False).flat)


def make_single_figure(height_in: float = 3.6) -> tuple[Figure, Axes]:
    """Make a figure with one pair of axes."""
    figure, axes = make_figure(height_in=height_in)
    return figure, axes[0]


def make_views(height_in: float = 5.0) -> tuple[Figure, Sequence[tuple[Axes, int, int]]]:
    """Make views from above (x, y) and from the side (x, z), in mm, to the same scale.

    Each view is its axes and the two columns of a position that it shows.
    """
    figure, axes = make_figure(1, 2, height_in)
    panels = [(axes[0], 0, 1), (axes[1], 0, 2)]
    for panel, across, up in panels:
        set_view(panel, across, up)
    return figure, panels


def set_view(panel: Axes, across: int, up: int) -> None:
    """Make *panel* show these two columns of positions in mm, to one scale."""
    panel.set_aspect("equal", adjustable="datalim")
    panel.set_title("from above" if up == 1 else "from the side")
    panel.set_xlabel(f"{'xyz'[across]}, mm")
    panel.set_ylabel(f"{'xyz'[up]}, mm")


def draw_dots(panel: Axes, x: F64, y: F64, label: str = "") -> None:
    """Draw readings as dots."""
    panel.scatter(x, y, s=5.0, alpha=0.4, linewidths=0.0, rasterized=True, label=label)


def make_svg(figure: Figure, salt: str, label: str) -> str:
    """Return the drawing as an element of a page; *salt* separates its identifiers from other
    drawings'.
    """
    with _use_style(salt):
        file = io.StringIO()
        figure.savefig(
            file, format="svg", dpi=DOTS_PER_INCH, transparent=True, metadata={"Date": None}
        )
    text = file.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'<g id="[^"]*">', "<g>", text)  # these identifiers occur in every drawing
    size = re.search(r'viewBox="[^"]*"', text)
    head = f'<svg role="img" aria-label="{html.escape(label)}" {size.group(0) if size else ""}'
    names = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    return re.sub(r"<svg[^>]*>", lambda _: f"{head} {names}>", text, count=1)
