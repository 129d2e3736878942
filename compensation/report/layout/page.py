"""One HTML page without a script: headings, text, tables, drawings as SVG, signature lines."""

from __future__ import annotations

import datetime
import hashlib
import html
import platform
import re
from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from armd import __version__
from armd.compensation.report.layout.drawing import make_svg
from armd.compensation.report.layout.style import STYLE, make_footer_style

#: The heading above everything that is not needed to decide.
APPENDIX = "Appendix"
#: The most items of a list, and letters of a sentence, that are shown in brief; the appendix has
#: the rest.
MOST_ITEMS = 6
#: The most items of a list whose sentences take some lines each.
MOST_SENTENCES = 4
MOST_LETTERS = 420
FAINT_ROW = '<tr class="faint">'


class Page:
    """A page that collects blocks in order; `to_html()` returns the whole file."""

    def __init__(self, title: str, footer: str = "") -> None:
        """Begin a page; *footer* is printed at the foot of each page, beside its number."""
        self.title = title
        self._footer = footer or title
        self._blocks = [f"<h1>{html.escape(title)}</h1>"]
        self._figures = 0
        self._level = 2
        self._put_off: list[tuple[str, list[str]]] = []

    def add_heading(self, text: str) -> None:
        self._blocks.append(f"<h{self._level}>{html.escape(text)}</h{self._level}>")

    def add_head(self, rows: Sequence[tuple[str, str | None]]) -> None:
        """Add the block of facts at the head; None is a line to be filled by hand."""
        inner = "".join(
            f"<div><dt>{html.escape(name)}</dt>"
            + (f"<dd>{html.escape(value)}</dd></div>" if value else '<dd class="blank"></dd></div>')
            for name, value in rows
        )
        self._blocks.append(f'<dl class="head">{inner}</dl>')

    def begin_appendix(self) -> None:
        """Begin the appendix: it is not needed to decide, and begins a new page on paper."""
        self._blocks.append(f'<h2 class="appendix" id="appendix">{APPENDIX}</h2>')
        self._level = 3
        for title, lines in self._put_off:
            self.add_heading(title)
            self.add_items(lines)
        self._put_off = []

    def add_items_in_brief(self, title: str, lines: Sequence[str], limit: int = MOST_ITEMS) -> None:
        """Add a list under *title*, shortened before the appendix, which then has it in full."""
        if not lines:
            return
        self.add_heading(title)
        items = [shorten(line) for line in lines[:limit]]
        if items != list(lines):
            self._put_off.append((title, list(lines)))
        if len(lines) > limit:
            items.append(f"{len(lines) - limit} more: {APPENDIX}.")
        self.add_items(items)

    def abbreviate(self, title: str, text: str) -> str:
        """Shorten *text* before the appendix, which then has it in full under *title*."""
        if (short := shorten(text)) != text:
            self._put_off.append((title, [text]))
            return f"{short} ({APPENDIX})"
        return text

    def add_text(self, text: str) -> None:
        self._blocks.append(f"<p>{html.escape(text)}</p>")

    def add_items(self, lines: Sequence[str]) -> None:
        """Add a list of sentences."""
        inner = "".join(f"<li>{html.escape(line)}</li>" for line in lines)
        self._blocks.append(f"<ul>{inner}</ul>")

    def add_verdict(self, word: str, reason: str, good: bool | None, key: str = "") -> None:
        """Add a word in large letters, and the reason; *good* is None for neither good nor bad.

        *key* is the one sentence that summarises the result.
        """
        kind = {True: "good", False: "bad", None: "neutral"}[good]
        sentence = f'<p class="key">{html.escape(key)}</p>' if key else ""
        self._blocks.append(
            f'<div class="verdict {kind}" role="status"><b>{html.escape(word)}</b>'
            f"{html.escape(reason)}{sentence}</div>"
        )

    def add_table(
        self,
        header: Sequence[str],
        rows: Sequence[Sequence[object]],
        faint: Sequence[bool] | None = None,
    ) -> None:
        """Add a table; numbers appear as given, so format them beforehand. *faint* rows
        are greyed.
        """
        first = [_get_cell_kind(value) for value in rows[0]] if rows else [""] * len(header)
        head = "".join(
            f"<th{kind}>{html.escape(name)}</th>" if name else "<td></td>"
            for name, kind in zip(header, first, strict=True)
        )
        marks = faint or [False] * len(rows)
        body = "".join(
            f"{FAINT_ROW if mark else '<tr>'}{''.join(map(_format_cell, row))}</tr>"
            for row, mark in zip(rows, marks, strict=True)
        )
        self._blocks.append(
            # A table wider than a phone scrolls, also by the keyboard.
            f'<div class="wide" tabindex="0"><table><thead><tr>{head}</tr></thead>'
            f"<tbody>{body}</tbody></table>"
            "</div>"
        )

    def add_figure(self, figure: Figure, caption: str) -> None:
        """Add a drawing; *caption* also describes it to readers who cannot see it."""
        self._figures += 1
        picture = make_svg(figure, f"figure {self._figures}", caption)
        self._blocks.append(
            f"<figure>{picture}<figcaption>{html.escape(caption)}</figcaption></figure>"
        )

    def add_origin(
        self, number: str, inputs: Mapping[str, str], facts: Mapping[str, str] | None = None
    ) -> None:
        """Add when, by which software and from which files the page was made.

        *inputs* are names and their SHA-256 in hexadecimal, *facts* are further entries for an
        auditor.
        """
        now = datetime.datetime.now(datetime.UTC)
        self.add_heading("Where it comes from")
        rows = {
            "report": f"{number}, {now:%Y-%m-%d %H:%M} UTC",
            "made by": f"armd {__version__}, Python {platform.python_version()}",
            **(facts or {}),
        }
        self.add_table(["", "value"], [[name, Long(value)] for name, value in rows.items()])
        if inputs:
            self.add_table(
                ["input", "SHA-256"], [[name, Long(sha)] for name, sha in inputs.items()]
            )

    def add_signature_lines(self, *roles: str) -> None:
        """Add a signature line for each of *roles*."""
        lines = "".join(f"<div>{html.escape(role)}, date, signature</div>" for role in roles)
        self._blocks.append(f'<div class="sign">{lines}</div>')

    def to_html(self) -> str:
        return (
            f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
            f'<meta name="viewport" content="width=device-width, initial-scale=1">'
            f'<meta name="generator" content="armd">'
            f"<title>{html.escape(self.title)}</title>"
            f"<style>{STYLE}{make_footer_style(self._footer)}</style></head>\n"
            f"<body><main>{''.join(self._blocks)}</main></body></html>\n"
        )


#: A number with its sign, and perhaps a short unit.
_NUMBER = re.compile(r"[+\-−]?\d[\d.,]*(e[+-]?\d+)?( ?[^\d\s]{1,3})?")


class Long(str):
    """Text of a table that may be broken anywhere, like a hash or a command."""


def make_report_number(serial: str, *sha256: str) -> str:
    """Make a report number from the arm's serial and eight digits of the inputs' joint hash.

    Equal inputs have equal numbers.
    """
    digest = hashlib.sha256("".join(sorted(sha256)).encode()).hexdigest()
    return f"{serial}-{digest[:8]}"


def shorten(text: str, limit: int = MOST_LETTERS) -> str:
    """Return the text, or its beginning if it is longer than *limit* letters."""
    return text if len(text) <= limit else f"{text[: limit - 1].rstrip()}…"


def _format_cell(value: object) -> str:
    return f"<td{_get_cell_kind(value)}>{html.escape(str(value))}</td>"


def _get_cell_kind(value: object) -> str:
    """Return the class of a cell: text is aligned left, numbers right, with their signs."""
    if isinstance(value, Long):
        return ' class="text long"'
    number = not isinstance(value, str) or not value or _NUMBER.fullmatch(value)
    return "" if number else ' class="text"'
