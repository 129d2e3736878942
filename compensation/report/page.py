"""One HTML page: headings, text, tables and plotly figures, with plotly's script inside."""

from __future__ import annotations

import html
from collections.abc import Sequence

import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 68rem; margin: 2rem auto; padding: 0 1rem;
       color: #1b1f24; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; }
table { border-collapse: collapse; margin: .6rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .15rem .7rem; border-bottom: 1px solid #d8dee4; text-align: right; }
th { background: #f3f5f7; } th:first-child, td:first-child { text-align: left; }
td.text, th.text { text-align: left; } code { background: #f3f5f7; padding: 0 .25rem; }
"""
#: Colours told apart by colour-blind readers too (Okabe and Ito).
COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"]
#: More points than this make a page slow and no picture clearer.
MOST_POINTS = 5000


class Page:
    """Collects blocks in order; `html()` is the whole file."""

    def __init__(self, title: str) -> None:
        self.title = title
        self._blocks = [f"<h1>{html.escape(title)}</h1>"]
        self._figures = 0

    def heading(self, text: str) -> None:
        self._blocks.append(f"<h2>{html.escape(text)}</h2>")

    def text(self, text: str) -> None:
        self._blocks.append(f"<p>{html.escape(text)}</p>")

    def items(self, lines: Sequence[str]) -> None:
        """A list of sentences."""
        inner = "".join(f"<li>{html.escape(line)}</li>" for line in lines)
        self._blocks.append(f"<ul>{inner}</ul>")

    def table(self, header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
        """Numbers stand as given: format them beforehand."""
        first = [_kind(value) for value in rows[0]] if rows else [""] * len(header)
        head = "".join(
            f"<th{kind}>{html.escape(name)}</th>" for name, kind in zip(header, first, strict=True)
        )
        body = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in rows)
        self._blocks.append(f"<table><tr>{head}</tr>{body}</table>")

    def figure(self, figure: go.Figure, height: int = 420) -> None:
        figure.update_layout(
            template="plotly_white", height=height, margin={"l": 60, "r": 80, "t": 30, "b": 50},
            colorway=COLOURS,
        )  # fmt: skip
        self._figures += 1
        self._blocks.append(
            figure.to_html(
                full_html=False,
                include_plotlyjs=False,
                div_id=f"figure-{self._figures}",
                config={"displaylogo": False},
            )
        )

    def html(self) -> str:
        return (
            f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
            f'<meta name="generator" content="armd">'
            f"<title>{html.escape(self.title)}</title><style>{STYLE}</style>"
            f"<script>{get_plotlyjs()}</script></head>\n"
            f"<body>{''.join(self._blocks)}</body></html>\n"
        )


def _cell(value: object) -> str:
    return f"<td{_kind(value)}>{html.escape(str(value))}</td>"


def _kind(value: object) -> str:
    """Text stands left, numbers right; a sign belongs to its number."""
    text = isinstance(value, str) and not value.lstrip("+-−")[:1].isdigit()
    return ' class="text"' if text else ""
