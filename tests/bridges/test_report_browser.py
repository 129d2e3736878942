"""The reports in a real browser: on a screen, on a phone, dark, and printed."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, sync_playwright

from armd import __version__
from armd.daemon.cli import COMMANDS, make_parsers
from armd.daemon.cli import main as armd
from support.browser import find_browser
from support.simulated_sessions import list_sessions, simulate_sessions

pytestmark = pytest.mark.timeout(600)

AXE = Path(__file__).parent / "axe" / "axe.min.js"
REPORTS = ("calibration", "verify", "diagnosis", "design", "interim", "recorrect")
#: That of `armd feature repeatability` has no verdict, and nothing to sign.
PAGES = (*REPORTS, "repeatability")
#: The command that writes each.
COMMAND = dict(zip(REPORTS, REPORTS, strict=True)) | {
    "calibration": "calibrate", "diagnosis": "diagnose", "repeatability": "feature",
}  # fmt: skip
#: What stands large at the top of each, and some of its reason.
VERDICTS = {
    "verify": ("NOT ACCEPTED", "1 of 10 figures, partial test"),
    "calibration": ("GRANTED", "not an ISO 17025"),
    "interim": ("IN CONTROL", "12 checks"),
    "diagnosis": ("ONE CAUSE FOUND", "encoder eccentricity, joint 3"),
    "design": ("MEASURE 12 POSES", "To "),
    "recorrect": ("30 OF 30 MEASUREMENTS AFFECTED", "by more than 0.05 mm"),
}
#: Those that take --about, have a head and an appendix.
SIGNED = ("calibration", "verify", "diagnosis", "interim")
ABOUT = {
    name: f"{name} {'of a long name ' * 7}"[:120].strip()
    for name in ("document", "customer", "laboratory", "place", "operator")
}
#: Columns of numbers with decimals that have no unit: a number of something, a share, a ratio.
WITHOUT_UNIT = (
    "probability", "difference / uncertainty", "correlation", "statistic", "limit", "value",
    "standard uncertainty", "in standard uncertainties", "standard deviations", "coefficient",
    "amplitude", "p that it is the same", "standard deviation", "at the last check", "started",
    "started, UTC", "pose",
)  # fmt: skip
SCREENS = {"screen": (1280, 900), "phone": (390, 844)}
MOST_BYTES = 500_000


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One of each kind, as the commands write them."""
    folder = tmp_path_factory.mktemp("reports")

    def simulate(kind: str, *more: str) -> list[str]:
        return list_sessions(simulate_sessions(folder / kind, kind, *more))

    about = "".join(f'{name} = "{text}"\n' for name, text in ABOUT.items())
    (folder / "about.toml").write_text(about)

    def page(kind: str) -> list[str]:
        head = ["--about", str(folder / "about.toml")] if kind in SIGNED else []
        return ["--report", str(folder / f"{kind}.html"), *head]

    measured = simulate("calibration")
    arm, calibration = str(folder / "calibration/arm.toml"), str(folder / "calibration.json")
    of_arm = ["--arm", arm, "--calibration", calibration]
    assert (
        armd(["calibrate", *measured, "--arm", arm, "-o", calibration, *page("calibration")]) == 0
    )
    (folder / "mpe.toml").write_text('schema = "armd.mpe/1"\n[mpe]\ne_uni_mm = 0.0001\n')
    mpe = ["--mpe", str(folder / "mpe.toml")]
    assert armd(["verify", *simulate("verify"), *of_arm, *mpe, *page("verify")]) == 1
    sick = simulate("diagnosis", "--plant", "encoder_eccentricity@joint 3=1.5")
    of_sick = ["--arm", str(folder / "diagnosis/arm.toml")]
    assert armd(["diagnose", *sick[:4], *of_sick, *page("diagnosis")]) == 0
    assert armd(["design", *sick[:4], *of_sick, *page("design")]) == 0
    history = ["--history", str(folder / "history")]
    checks = simulate("interim", "--days", "12")
    assert armd(["interim", "add", *checks, *of_arm, *history]) == 0
    assert armd(["interim", "report", *history, *page("interim")]) == 0
    (folder / "points.jsonl").write_text("".join(measurements()))
    again = ["recorrect", str(folder / "points.jsonl"), *of_arm, "--tolerance", "0.05"]
    assert armd([*again, "-o", str(folder / "again.csv"), *page("recorrect")]) == 0
    visits = np.random.default_rng(5).normal([300.0, 0.0, 200.0], 0.02, (40, 3))
    rows = "".join("{:.4f},{:.4f},{:.4f}\n".format(*visit) for visit in visits)
    (folder / "visits.csv").write_text(f"x_mm,y_mm,z_mm\n{rows}")
    visited = ["feature", "repeatability", str(folder / "visits.csv")]
    assert armd([*visited, *page("repeatability")]) == 0
    return folder


def measurements() -> Iterator[str]:
    """As the daemon publishes them: a line of JSON each."""
    rng = np.random.default_rng(3)
    for i in range(30):
        yield json.dumps(
            {
                "seq": i, "stamp_ns": 1772500000_000000000 + i * 10_000_000_000,
                "position_mm": rng.uniform(200.0, 500.0, 3).tolist(),
                "angles_rad": rng.uniform(-1.0, 1.0, 6).tolist(), "rates_rad_s": [0.0] * 6,
                "temperatures_c": {f"t{k}": 21.0 for k in range(1, 7)}, "tip": None,
                "flags": 512, "buttons": 1, "count": 10, "calibration": "0123456789abcdef",
            }
        ) + "\n"  # fmt: skip


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    found = find_browser()
    if found is None:
        pytest.skip("no browser: `make browser` installs Debian's Chromium")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield browser
        browser.close()


def test_there_is_no_report_that_nobody_looks_at() -> None:
    _, commands = make_parsers(COMMANDS.keys() - {"simulate"})  # a program of its own
    writing = {name for name, command in commands.items() if "--report" in command.list_options()}
    assert writing == set(COMMAND.values())


@pytest.mark.slow
@pytest.mark.parametrize("report", PAGES)
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("screen", SCREENS)
def test_it_is_readable_on_a_screen(
    reports: Path, browser: Browser, report: str, scheme: str, screen: str
) -> None:
    file = reports / f"{report}.html"
    assert file.stat().st_size < MOST_BYTES
    width, height = SCREENS[screen]
    size = {"width": width, "height": height}
    page = browser.new_page(viewport=size, color_scheme=scheme)  # type: ignore[arg-type]
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(file.as_uri())
    assert asked == [file.as_uri()]  # it opens offline
    wide = page.evaluate("document.documentElement.scrollWidth")
    assert wide <= width  # what is wide scrolls by itself
    assert page.locator("button, input, script").count() == 0
    dark = page.evaluate(
        "getComputedStyle(document.body).backgroundColor.match(/\\d+/g).map(Number)[0] < 128"
    )
    assert dark == (scheme == "dark")
    page.add_script_tag(path=AXE)
    faults = page.evaluate("async () => (await axe.run()).violations.map((v) => v.id)")
    assert faults == []
    page.close()


@pytest.mark.slow
@pytest.mark.parametrize("report", REPORTS)
@pytest.mark.parametrize("screen", SCREENS)
def test_the_verdict_is_seen_first(
    reports: Path, browser: Browser, report: str, screen: str
) -> None:
    """From across the room: large, in the first view, with its reason below."""
    width, height = SCREENS[screen]
    page = browser.new_page(viewport={"width": width, "height": height})
    page.goto((reports / f"{report}.html").as_uri())
    told, reason = VERDICTS[report]
    word = page.locator(".verdict b")
    assert word.inner_text() == told
    assert word.evaluate("e => parseFloat(getComputedStyle(e).fontSize)") > 30
    box = word.bounding_box()
    assert box is not None and box["y"] + box["height"] < height
    assert reason in page.locator(".verdict").inner_text()
    page.close()


@pytest.mark.slow
@pytest.mark.parametrize("report", REPORTS)
def test_every_input_is_named_by_its_hash(reports: Path, report: str) -> None:
    page = (reports / f"{report}.html").read_text(encoding="utf-8")
    inputs = dict(re.findall(r'<td class="text">([^<]*)</td><td class="text long">(\w{64})', page))
    arms = {hashlib.sha256(arm.read_bytes()).hexdigest() for arm in reports.glob("*/arm.toml")}
    assert arms & set(inputs.values())
    if report in ("verify", "recorrect", "interim", "calibration"):
        calibration = hashlib.sha256((reports / "calibration.json").read_bytes()).hexdigest()
        assert calibration in page
    if report == "verify":
        limits = hashlib.sha256((reports / "mpe.toml").read_bytes()).hexdigest()
        assert inputs["limits mpe.toml"] == limits


#: Of the sessions or measurements that a report is of.
FACTS = {
    "recorrect": ("operator", "temperatures of the arm while measuring", "tolerance"),
    "calibration": ("operator", "its certificate", "arm, °C", "artefact, °C", "uncertainty"),
    "verify": ("operator", "its certificate", "arm, °C", "artefact, °C", "U (k = 2), µm"),
    "diagnosis": ("operator", "its certificate", "arm, °C", "artefact, °C", "uncertainty"),
    "design": ("operator", "its certificate", "arm, °C", "artefact, °C"),
    "interim": ("operator", "its certificate", "arm, °C", "artefact, °C"),
}


@pytest.mark.slow
@pytest.mark.parametrize("report", REPORTS)
def test_what_an_auditor_asks(reports: Path, report: str) -> None:
    text = (reports / f"{report}.html").read_text(encoding="utf-8")
    assert re.search(r"[\w-]+-[0-9a-f]{8}, \d{4}-\d\d-\d\d \d\d:\d\d UTC", text)  # number, date
    assert f"armd {__version__}, Python" in text
    assert [fact for fact in FACTS[report] if fact not in text] == []
    assert "ecision rule" in text  # or that there is none, and why
    assert len(re.findall("date, signature", text)) == (1 if report == "interim" else 2)


@pytest.mark.slow
@pytest.mark.parametrize("report", PAGES)
def test_no_formula_is_left_unset(reports: Path, report: str) -> None:
    """As matplotlib writes the numbers of some axes."""
    assert "\\math" not in (reports / f"{report}.html").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("report", PAGES)
def test_it_prints(reports: Path, browser: Browser, report: str) -> None:
    page = browser.new_page(color_scheme="dark")
    page.goto((reports / f"{report}.html").as_uri())
    page.emulate_media(media="print")
    white = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert white == "rgb(255, 255, 255)"
    # A4 less its margins is 180 mm; nothing is cut off at its right edge.
    page.set_viewport_size({"width": 680, "height": 1000})
    assert page.evaluate("document.documentElement.scrollWidth") <= 680
    for kind in ("figure", "tr"):
        for element in page.locator(kind).all()[:20]:
            assert element.evaluate("e => getComputedStyle(e).breakInside") == "avoid"
    pdf = page.pdf(format="A4")
    pages = len(re.findall(rb"/Type\s*/Page\b", pdf))
    assert 1 <= pages <= 40
    page.close()


@pytest.mark.slow
@pytest.mark.parametrize("report", SIGNED)
def test_what_decides_is_on_two_pages(reports: Path, browser: Browser, report: str) -> None:
    """Whatever stands in its head; what decides is signed before the appendix."""
    page = browser.new_page()
    page.goto((reports / f"{report}.html").as_uri())
    pdf = page.pdf(prefer_css_page_size=True, tagged=True, outline=True)
    page.close()
    pages = sorted(int(n) for n in re.findall(rb"(\d+) 0 obj\s*<</Type /Page\s", pdf))
    (begins,) = re.findall(rb"/Title \(Appendix\)\s*/Dest \[(\d+) 0 R", pdf)
    assert pages.index(int(begins)) + 1 <= 3
    text = (reports / f"{report}.html").read_text(encoding="utf-8")
    before, after = text.split('id="appendix"')
    assert "date, signature" in before and "date, signature" not in after
    assert [words for words in ABOUT.values() if words not in before] == []
    assert '<p class="key">' in before


@pytest.mark.slow
@pytest.mark.parametrize("report", SIGNED)
def test_nothing_is_cut_off_and_every_number_has_its_unit(
    reports: Path, browser: Browser, report: str
) -> None:
    page = browser.new_page(viewport={"width": 680, "height": 1000})
    page.goto((reports / f"{report}.html").as_uri())
    page.emulate_media(media="print")
    assert page.evaluate(CUT_OFF) == []
    assert re.findall(r"\b(?:nan|NaN|inf|None)\b", page.inner_text("main")) == []
    drawn = "\n".join(page.locator("svg text").all_text_contents())
    assert re.findall(r"\b(?:nan|inf)\b", drawn) == []
    without = [name for name in page.evaluate(NO_UNIT) if name not in WITHOUT_UNIT]
    assert without == []
    page.close()


#: Tables wider than the paper, letters of drawings outside of them, words broken in a heading.
CUT_OFF = """() => [
  ...[...document.querySelectorAll(".wide")]
    .filter((e) => e.scrollWidth > e.clientWidth + 1).map((e) => e.innerText.slice(0, 60)),
  ...[...document.querySelectorAll("svg")].flatMap((svg) => {
    const all = svg.getBoundingClientRect();
    return [...svg.querySelectorAll("text")].filter((text) => {
      const box = text.getBoundingClientRect();
      return box.width && (box.left < all.left - 3 || box.right > all.right + 3
        || box.top < all.top - 3 || box.bottom > all.bottom + 3);
    }).map((text) => text.textContent);
  })]"""
#: Names of columns that have numbers with decimals, and neither column nor cell has a unit.
NO_UNIT = """() => [...new Set([...document.querySelectorAll("table")].flatMap((table) => {
  const names = [...table.querySelectorAll("thead > tr > *")].map((cell) => cell.innerText);
  return names.filter((name, i) => !/, (µm|mm|″|°|°C|h|K)\\b|, (″|°)|(µm|mm) RMS|% /.test(name)
    && [...table.querySelectorAll("tbody tr")].some(
      (row) => /^[+−-]?\\d+\\.\\d+$/.test(row.children[i].innerText)));
}))]"""
