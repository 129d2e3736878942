"""A page is one small file without a script that prints, and says where it comes from."""

from __future__ import annotations

import re

import numpy as np

from armd.compensation.report.drawing import MOST_POINTS, cloud, one_drawing, views
from armd.compensation.report.page import Page, report_number


def a_page() -> Page:
    page = Page("Arm <A>")
    rng = np.random.default_rng(1)
    figure, panel = one_drawing()
    cloud(panel, *rng.normal(size=(2, MOST_POINTS)), "readings of $B_1$")
    panel.set(xlabel="joint 1, °", ylabel="error, µm")
    panel.legend()
    page.figure(figure, 'error & "angle"')
    figure, panels = views()
    for drawn, across, up in panels:
        drawn.plot([across, up], [0, 1])
    page.figure(figure, "two views")
    return page


def test_a_drawing_is_small_stands_alone_and_keeps_its_words() -> None:
    page = a_page().html()
    assert len(page) < 150_000  # 5000 dots are a picture within the drawing
    assert page.count("<svg") == 2 and "<script" not in page
    outside = {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}
    assert set(re.findall(r'https?://[^"\s<)]*', page)) <= outside  # names, not requests
    for words in ("joint 1, °", "error, µm", "readings of $B_1$", "from above", "z, mm"):
        assert words in page  # letters, not outlines: they print, and can be searched
    assert 'aria-label="error &amp; &quot;angle&quot;"' in page
    assert "<h1>Arm &lt;A&gt;</h1>" in page


def test_no_two_parts_of_a_page_share_a_name() -> None:
    page = a_page().html()
    names = re.findall(r'\bid="([^"]*)"', page)
    assert len(names) == len(set(names)) > 0
    used = set(re.findall(r'(?:href="|url\()#([^")]*)', page))
    assert used and used <= set(names)


def test_the_origin_is_named_and_signed() -> None:
    page = Page("P")
    page.verdict("FAILED", "by 3 µm", good=False)
    number = report_number("A-1", "00ff", "aa")
    page.origin(number, {"session s": "00ff"}, {"operator": "Li"})
    page.signatures("Measured by")
    text = page.html()
    assert number == report_number("A-1", "aa", "00ff") != report_number("A-1", "aa")
    for words in (number, "UTC", "armd ", "session s", "00ff", "Li", "Measured by, date"):
        assert words in text
    assert '<div class="verdict bad" role="status"><b>FAILED</b>by 3 µm</div>' in text
    assert "@media print" in text
