"""Displays a result as text of at most one screen, and as HTML in a notebook."""

from __future__ import annotations

import html
import os
from collections.abc import Sequence
from pathlib import Path

#: A screen: number of lines, and of characters a line.
MOST_LINES, MOST_WIDE = 24, 100

Facts = Sequence[tuple[str, str]]


def shorten(text: str, max_length: int = MOST_WIDE) -> str:
    """Return the first line of *text*, cut to *max_length* characters."""
    line = " ".join(text.split())
    return line if len(line) <= max_length else line[: max_length - 1] + "…"


class Displayed:
    """A result that prints as a title and a line for each of its facts."""

    def _describe(self) -> tuple[str, Facts]:
        """Return the title, and names with values in words."""
        raise NotImplementedError

    def __repr__(self) -> str:
        title, facts = self._describe()
        width = max((len(name) for name, _ in facts), default=0)
        lines = [title, *(f"  {name:<{width}}  {value}" for name, value in facts)]
        if len(lines) > MOST_LINES:
            lines = [*lines[: MOST_LINES - 1], f"  … {len(lines) - MOST_LINES + 1} more"]
        return "\n".join(shorten_end(line) for line in lines)

    def _repr_html_(self) -> str:
        title, facts = self._describe()
        rows = "".join(
            f"<tr><th style='text-align:left'>{html.escape(name)}</th>"
            f"<td style='text-align:left'>{html.escape(value)}</td></tr>"
            for name, value in facts
        )
        return f"<div><p><b>{html.escape(title)}</b></p><table>{rows}</table></div>"

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, str]:
        """Return both forms, for notebooks."""
        return {"text/plain": repr(self), "text/html": self._repr_html_()}


class Reported(Displayed):
    """A result that also has the report of its command."""

    def page(self) -> str:
        """Return the report as HTML. Not public."""
        raise NotImplementedError

    def report(self, path: str | os.PathLike[str]) -> None:
        """Write the report of the command of this name to *path*: HTML, or PDF by its suffix
        `.pdf`.

        Raises `armd.ArmdError` where no program prints a PDF.
        """
        from armd.compensation.report.layout.written import write_page  # loads slowly

        write_page(Path(path), self.page())


def shorten_end(line: str) -> str:
    """Return *line*, cut at its end if it is wider than a screen."""
    return line if len(line) <= MOST_WIDE else line[: MOST_WIDE - 1] + "…"
