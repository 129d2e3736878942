"""Writes a report's page as HTML, and as PDF if a Chromium is installed."""

from __future__ import annotations

import argparse
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

from armd.errors import ArmdError, BadInput
from armd.files.outputs import PAGE, PDF, PDF_MARK, OutputKind
from armd.files.writing import write_whole
from armd.terminal.aside import make_aside

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
PRINTING_S = 120.0


def add_pages(
    parser: argparse.ArgumentParser, description: str = "a report that opens offline"
) -> None:
    """Add the options --report and --pdf."""
    parser.add_argument("--report", metavar="R.html", help=description)
    parser.add_argument("--pdf", metavar="R.pdf", help="the same, printed by an installed Chromium")


def list_page_outputs(args: argparse.Namespace) -> dict[str, tuple[str | Path | None, OutputKind]]:
    """List the pages asked for, for `check_outputs`; raises `BadInput` if --pdf has no browser."""
    if args.pdf and _find_browser() is None:
        expected = f"one of {', '.join(BROWSERS)} on the path; or print the page of --report"
        raise BadInput("command line", "--pdf", "no browser", expected)
    return {"--report": (args.report, PAGE), "--pdf": (args.pdf, PDF)}


def write_pages(args: argparse.Namespace, make: Callable[[], str]) -> None:
    """Write the pages asked for; *make* makes the page, and is called only if one is."""
    if args.report or args.pdf:
        console = make_aside(args)
        with console.status("drawing the page …"):
            page = make()
        if args.report:
            write_whole(args.report, page)
        if args.pdf:
            with console.status("printing the page …"):
                write_pdf(Path(args.pdf), page)


def write_page(path: Path, page: str) -> None:
    """Write a page to *path*: HTML, or PDF by its suffix; raises `ArmdError` if it cannot be
    printed.
    """
    if path.suffix.lower() == ".pdf":
        write_pdf(path, page)
    else:
        write_whole(path, page)


def write_pdf(path: Path, page: str) -> None:
    """Write a page as PDF; raises `ArmdError` if it cannot be printed."""
    write_whole(path, print_pdf(page) + PDF_MARK)


def print_pdf(page: str) -> bytes:
    """Return the page as PDF; raises `ArmdError` without a browser, or if it makes none."""
    browser = _find_browser()
    if browser is None:
        raise ArmdError(f"no PDF: none of {', '.join(BROWSERS)} is on the path")
    with tempfile.TemporaryDirectory(prefix="armd-pdf-") as folder:
        html, pdf = Path(folder, "page.html"), Path(folder, "page.pdf")
        html.write_text(page, encoding="utf-8")
        command = [
            browser, "--headless", "--no-sandbox", "--disable-gpu", "--no-pdf-header-footer",
            f"--user-data-dir={folder}/profile", f"--print-to-pdf={pdf}", html.as_uri(),
        ]  # fmt: skip
        try:
            done = subprocess.run(command, capture_output=True, timeout=PRINTING_S, text=True)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise ArmdError(f"no PDF: {browser}: {error}") from error
        if not pdf.exists():
            raise ArmdError(f"no PDF: {browser}: {done.stderr.strip()[-300:]}")
        return pdf.read_bytes()


def _find_browser() -> str | None:
    return next((path for name in BROWSERS if (path := shutil.which(name))), None)
