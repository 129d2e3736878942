"""One HTML page without a script: headings, text, tables, drawings as SVG, lines to sign on."""

from __future__ import annotations

import datetime
import hashlib
import html
import platform
import re
from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from armd import __version__
from armd.compensation.report.drawing import svg

STYLE = """
:root { color-scheme: light dark; --ink: #1b1f24; --paper: #fff; --line: #d8dee4; --head: #f3f5f7;
        --good: #116329; --bad: #a40e26; --neutral: #57606a; }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 68rem; margin: 2rem auto; padding: 0 1rem;
       color: var(--ink); background: var(--paper); overflow-wrap: anywhere; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; margin: .6rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .15rem .7rem; border-bottom: 1px solid var(--line); text-align: right; }
th, td { overflow-wrap: normal; } td.long { overflow-wrap: anywhere; }
th { background: var(--head); } th:first-child, td:first-child { text-align: left; }
td.text, th.text { text-align: left; }
figure { margin: .8rem 0; } figure svg { width: 100%; height: auto; max-width: 60rem; }
figcaption { color: var(--neutral); }
.verdict { margin: 1.2rem 0; padding: .6rem 1.2rem; border: .35rem solid; border-radius: .4rem; }
.verdict b { display: block; font-size: clamp(2.2rem, 9vw, 4.5rem); line-height: 1.15; }
.good { color: var(--good); } .bad { color: var(--bad); } .neutral { color: var(--neutral); }
.sign { display: flex; flex-wrap: wrap; gap: 2.5rem; margin-top: 3.5rem; }
.sign div { flex: 1 1 14rem; border-top: 1px solid var(--ink); padding-top: .3rem; }
@media screen and (prefers-color-scheme: dark) {
  :root { --ink: #e6edf3; --paper: #0d1117; --line: #30363d; --head: #161b22;
          --good: #56d364; --bad: #ff7b72; --neutral: #9198a1; }
  figure svg { filter: invert(.9) hue-rotate(180deg); } }
@media print {
  :root { color-scheme: light; }
  body { font-size: 10pt; max-width: none; margin: 0; padding: 0; }
  h2 { break-after: avoid; } tr, figure, .verdict, .sign { break-inside: avoid; }
  thead { display: table-header-group; } .wide { overflow: visible; }
  table { font-size: 8pt; } th, td { padding: .1rem .3rem; overflow-wrap: anywhere; } }
@page { margin: 18mm 15mm; @bottom-right { content: counter(page) " / " counter(pages); } }
"""


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

    def verdict(self, word: str, reason: str, good: bool | None) -> None:
        """One word that can be read from across the room, and why; None is neither."""
        kind = {True: "good", False: "bad", None: "neutral"}[good]
        self._blocks.append(
            f'<div class="verdict {kind}" role="status"><b>{html.escape(word)}</b>'
            f"{html.escape(reason)}</div>"
        )

    def table(self, header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
        """Numbers stand as given: format them beforehand."""
        first = [_kind(value) for value in rows[0]] if rows else [""] * len(header)
        head = "".join(
            f"<th{kind}>{html.escape(name)}</th>" if name else "<td></td>"
            for name, kind in zip(header, first, strict=True)
        )
        body = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in rows)
        self._blocks.append(
            # What is wider than a phone scrolls, by the keyboard too.
            f'<div class="wide" tabindex="0"><table><thead><tr>{head}</tr></thead>'
            f"<tbody>{body}</tbody></table>"
            "</div>"
        )

    def figure(self, figure: Figure, caption: str) -> None:
        """A drawing; *caption* says what it shows, also to who cannot see it."""
        self._figures += 1
        drawing = svg(figure, f"figure {self._figures}", caption)
        self._blocks.append(
            f"<figure>{drawing}<figcaption>{html.escape(caption)}</figcaption></figure>"
        )

    def origin(
        self, number: str, inputs: Mapping[str, str], facts: Mapping[str, str] | None = None
    ) -> None:
        """When, by what and from what the page was made.

        *inputs* are names and their SHA-256 in hexadecimal, *facts* whatever else an auditor asks.
        """
        now = datetime.datetime.now(datetime.UTC)
        self.heading("Where it comes from")
        rows = {
            "report": f"{number}, {now:%Y-%m-%d %H:%M} UTC",
            "made by": f"armd {__version__}, Python {platform.python_version()}",
            **(facts or {}),
        }
        self.table(["", "value"], [[name, Long(value)] for name, value in rows.items()])
        if inputs:
            self.table(["input", "SHA-256"], [[name, Long(sha)] for name, sha in inputs.items()])

    def signatures(self, *roles: str) -> None:
        """A line for each of *roles* to sign on."""
        lines = "".join(f"<div>{html.escape(role)}, date, signature</div>" for role in roles)
        self._blocks.append(f'<div class="sign">{lines}</div>')

    def html(self) -> str:
        return (
            f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
            f'<meta name="viewport" content="width=device-width, initial-scale=1">'
            f'<meta name="generator" content="armd">'
            f"<title>{html.escape(self.title)}</title><style>{STYLE}</style></head>\n"
            f"<body><main>{''.join(self._blocks)}</main></body></html>\n"
        )


#: A number with its sign, and perhaps a short unit.
_NUMBER = re.compile(r"[+\-−]?\d[\d.,]*(e[+-]?\d+)?( ?[^\d\s]{1,3})?")


class Long(str):
    """Text of a table that may be broken anywhere, as a hash or a command."""


def report_number(serial: str, *sha256: str) -> str:
    """The same inputs make the same number: the arm's serial and eight digits of their hashes."""
    digest = hashlib.sha256("".join(sorted(sha256)).encode()).hexdigest()
    return f"{serial}-{digest[:8]}"


def _cell(value: object) -> str:
    return f"<td{_kind(value)}>{html.escape(str(value))}</td>"


def _kind(value: object) -> str:
    """Text stands left, numbers right; a sign belongs to its number."""
    if isinstance(value, Long):
        return ' class="text long"'
    number = not isinstance(value, str) or not value or _NUMBER.fullmatch(value)
    return "" if number else ' class="text"'
