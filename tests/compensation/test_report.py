"""A page is one small file without a script that prints, and says where it comes from."""

from __future__ import annotations

import argparse
import os
import re
import shutil

import numpy as np
import pytest

from armd.compensation.report.layout import written
from armd.compensation.report.layout.drawing import (
    MOST_POINTS,
    draw_dots,
    make_single_figure,
    make_views,
)
from armd.compensation.report.layout.page import Page, make_report_number
from armd.errors import ArmdError, BadInput


def a_page() -> Page:
    page = Page("Arm <A>")
    rng = np.random.default_rng(1)
    figure, panel = make_single_figure()
    draw_dots(panel, *rng.normal(size=(2, MOST_POINTS)), "readings of $B_1$")
    panel.set(xlabel="joint 1, °", ylabel="error, µm")
    panel.legend()
    page.add_figure(figure, 'error & "angle"')
    figure, panels = make_views()
    for drawn, across, up in panels:
        drawn.plot([across, up], [0, 1])
    page.add_figure(figure, "two views")
    return page


def test_a_drawing_shows_itself_in_a_notebook_without_pyplot() -> None:
    figure, panel = make_single_figure()
    panel.plot([0.0, 1.0])
    shown = figure._repr_png_()  # by this name a notebook asks
    assert shown.startswith(b"\x89PNG") and len(shown) < 50_000


def test_a_drawing_is_small_stands_alone_and_keeps_its_words() -> None:
    page = a_page().to_html()
    assert len(page) < 150_000  # 5000 dots are a picture within the drawing
    assert page.count("<svg") == 2 and "<script" not in page
    outside = {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}
    assert set(re.findall(r'https?://[^"\s<)]*', page)) <= outside  # names, not requests
    for words in ("joint 1, °", "error, µm", "readings of $B_1$", "from above", "z, mm"):
        assert words in page  # letters, not outlines: they print, and can be searched
    assert 'aria-label="error &amp; &quot;angle&quot;"' in page
    assert "<h1>Arm &lt;A&gt;</h1>" in page


def test_no_two_parts_of_a_page_share_a_name() -> None:
    page = a_page().to_html()
    names = re.findall(r'\bid="([^"]*)"', page)
    assert len(names) == len(set(names)) > 0
    used = set(re.findall(r'(?:href="|url\()#([^")]*)', page))
    assert used and used <= set(names)


def test_the_origin_is_named_and_signed() -> None:
    page = Page("P")
    page.add_verdict("FAILED", "by 3 µm", good=False)
    number = make_report_number("A-1", "00ff", "aa")
    page.add_origin(number, {"session s": "00ff"}, {"operator": "Li"})
    page.add_signature_lines("Measured by")
    text = page.to_html()
    assert number == make_report_number("A-1", "aa", "00ff") != make_report_number("A-1", "aa")
    for words in (number, "UTC", "armd ", "session s", "00ff", "Li", "Measured by, date"):
        assert words in text
    assert '<div class="verdict bad" role="status"><b>FAILED</b>by 3 µm</div>' in text
    assert "@media print" in text


def test_without_a_browser_a_pdf_is_refused_before_the_work(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(written, "BROWSERS", ("no-such-browser",))
    parser = argparse.ArgumentParser()
    written.add_pages(parser)
    asked = parser.parse_args(["--pdf", str(tmp_path / "r.pdf")])
    with pytest.raises(BadInput, match=r"--pdf: found no browser, expected one of no-such-browser"):
        written.list_page_outputs(asked)
    assert written.list_page_outputs(parser.parse_args([]))["--pdf"][0] is None


def test_a_browser_that_prints_nothing_is_told(monkeypatch, tmp_path) -> None:
    browser = tmp_path / "chromium"
    browser.write_text("#!/bin/sh\necho no display >&2\n")
    browser.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    with pytest.raises(ArmdError, match=r"no PDF: .*chromium: no display"):
        written.print_pdf("<p>")


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("chromium"), reason="no Chromium: make browser")
def test_a_page_prints_whole(tmp_path) -> None:
    asked = argparse.Namespace(report=None, pdf=tmp_path / "r.pdf", quiet=True, verbose=False)
    written.write_pages(asked, lambda: a_page().to_html())
    pdf = (tmp_path / "r.pdf").read_bytes()
    assert pdf.startswith(b"%PDF-") and b"/Count" in pdf and len(pdf) > 10_000
