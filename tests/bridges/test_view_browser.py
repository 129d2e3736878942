"""The page of `armd view` in a real browser, fed by a live arm."""

from __future__ import annotations

import csv
import datetime
import io
import json
import re
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, sync_playwright
from playwright.sync_api import TimeoutError as PageTimeout

import armd
from armd import keys
from armd.compensation.data.sessions.session import load_session
from armd.compensation.model.arm import load_arm
from armd.compensation.model.kinematics import compute_pose
from armd.daemon.files.tip_history import keep
from support.browser import find_browser
from support.punctuality import Punctuality
from support.running_bridge import RunningBridge, running_bridge
from support.running_daemon import Daemon, free_endpoint, running_daemon
from support.simulated_arm import SimulatedArm, simulated_arm

pytestmark = pytest.mark.timeout(600)
AXE = Path(__file__).parent / "axe" / "axe.min.js"
OUT = Path(__file__).parents[2] / "out"
PATIENCE_MS = 60_000
TIPS = "[commands]\nenabled = true\n[tips.ruby]\noffset_mm = [0.0, 0.0, 150.0]\nradius_mm = 1.5\n"
CHECKS = '[interim]\nhistory = "checks"\n'
#: Notes each figure with the seq it belongs to, as a person's screen has them.
NOTE = """() => {
  window.noted = [];
  const figures = document.getElementById("figures");
  new MutationObserver(() => window.noted.push(
    [Number(figures.dataset.seq), performance.now(),
     ...["x", "y", "z"].map((axis) => document.getElementById(axis).textContent)],
  )).observe(figures, { attributes: true, attributeFilter: ["data-seq"] });
}"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    found = find_browser()
    if found is None:
        pytest.skip("no browser: `make browser` installs Debian's Chromium")
    software = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=found, args=software)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimulatedArm]:
    with simulated_arm(tmp_path_factory.mktemp("view"), seconds=1500) as arm:
        yield arm


@pytest.fixture(scope="module")
def daemon(arm: SimulatedArm) -> Iterator[Daemon]:
    checked(arm.folder, "in_control")
    with running_daemon(arm.folder, arm.port, extra=TIPS + CHECKS) as daemon:
        yield daemon


def checked(folder: Path, state: str, *changes: dict[str, Any]) -> None:
    """What `armd interim` leaves in the history's folder; the last check was three hours ago."""
    started = datetime.datetime.now(datetime.UTC) - datetime.timedelta(hours=3)
    check = {"name": "day-04", "started": f"{started:%FT%TZ}"}
    told = {"schema": "armd.interim/1", "state": state, "calibration": "abc", "checks": [check]}
    (folder / "checks").mkdir(exist_ok=True)
    (folder / "checks" / "report.json").write_text(json.dumps(told | {"changes": changes}))


@contextmanager
def viewing(endpoint: str, *more: str, listen: str = "127.0.0.1:0") -> Iterator[RunningBridge]:
    options = ("SIM-0001", "--endpoint", endpoint, "--listen", listen, *more)
    with running_bridge("view", *options) as view:
        yield view


@pytest.fixture(scope="module")
def view(daemon: Daemon, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningBridge]:
    sessions = str(tmp_path_factory.mktemp("sessions"))
    with viewing(daemon.endpoint, "--allow-commands", "--sessions", sessions) as view:
        yield view


@contextmanager
def opened(browser: Browser, where: str, wait: bool = True, **context: Any) -> Iterator[Page]:
    """A page with figures on it; fails on any error of its own, and on any foreign request."""
    complaints: list[str] = []
    with browser.new_context(accept_downloads=True, **context) as own:
        page = own.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on(
            "request",
            lambda request: (
                request.url.startswith((f"http://{where}/", "data:", "blob:"))
                or complaints.append(request.url)
            ),
        )
        page.on(
            "console",
            lambda said: (
                said.type == "error"
                and "ERR_" not in said.text  # a server that is away
                and complaints.append(said.text)
            ),
        )
        page.goto(f"http://{where}/")
        if wait:
            live(page)
        yield page
        assert complaints == []


def live(page: Page) -> None:
    """Until the figures are those of now, and the arm's geometry is known."""
    page.wait_for_function(
        "() => !document.getElementById('readout').classList.contains('old')"
        " && /\\d\\.\\d{3}$/.test(document.getElementById('x').textContent)"
        " && document.getElementById('tip').textContent !== '–'"
    )


def test_what_is_looked_for_is_on_the_page() -> None:
    """Without a browser: whoever renames a part of the page learns it before `make browser`."""
    asked = set(
        re.findall(r"""(?:getElementById\(['"]|["' ]#)([a-z][\w-]*)""", Path(__file__).read_text())
    )
    page = Path(str(resources.files("armd.daemon.bridges.view") / "page"))
    parts = "".join(file.read_text() for file in [*page.glob("*.html"), *page.glob("*.js")])
    assert len(asked) > 20
    assert [name for name in sorted(asked) if not re.search(rf"""["'`]{name}["'`]""", parts)] == []


@pytest.mark.serial
@pytest.mark.slow
def test_the_figures_are_the_streams_many_times_a_second(
    browser: Browser, daemon: Daemon, view: RunningBridge, punctuality: Punctuality
) -> None:
    with daemon.listen() as heard, opened(browser, view.where) as page:
        page.evaluate(NOTE)
        with punctuality.watch() as machine:
            page.evaluate("window.noted = []")
            page.wait_for_timeout(5000)
            noted = page.evaluate("window.noted")
        heard.wait_for(lambda: heard.points()["seq"][-1] > noted[-1][0])
        positions = {int(p["seq"]): p["position_mm"] for p in heard.points()}
        figures = [(seq, texts) for seq, _, *texts in noted if texts[0] != "–"]
        for seq, texts in figures:
            shown = np.array([float(text) for text in texts])
            assert np.abs(shown - positions[seq]).max() <= 0.0005 + 1e-9
        updates, took_s = len(noted) - 1, (noted[-1][1] - noted[0][1]) / 1000
        print(f"{updates / took_s:.1f} updates a second, {len(figures)} compared")
        assert figures
        machine.judge(took_s, updates / 10, f"{updates} updates of the page")  # by the contract
        kept = page.evaluate("performance.getEntriesByType('resource').map((r) => r.name)")
        assert all(name.startswith(f"http://{view.where}/") for name in kept)


@pytest.mark.slow
def test_the_arm_is_drawn_where_the_kernel_has_it(
    browser: Browser, arm: SimulatedArm, view: RunningBridge
) -> None:
    nominal = load_arm(arm.arm_toml).nominal()
    nominal[-6:] = [3.0, -2.0, 1.0, 0.02, -0.03, 0.04]  # a base that is displaced
    q = np.random.default_rng(5).uniform(-3, 3, (20, 6))
    geometry = {
        "rows": nominal[:30].reshape(6, 5).tolist(),
        "tip": nominal[30:33].tolist(),
        "base": nominal[33:].tolist(),
    }
    with opened(browser, view.where) as page:
        drawn = page.evaluate(
            "async ([geometry, all]) => {"
            " const { tip } = await import('/kinematics.js');"
            " return all.map((q) => tip(geometry, q)); }",
            [geometry, q.tolist()],
        )
        assert np.allclose(drawn, compute_pose(q, nominal)[0], atol=1e-9)
        told = page.evaluate("import('/main.js').then((main) => main.page.arm.geometry.rows)")
        assert np.allclose(told, load_arm(arm.arm_toml).nominal()[:30].reshape(6, 5))
        # The picture is not empty, and it moves.
        canvas = page.locator("#canvas")
        first = canvas.screenshot()
        page.wait_for_timeout(1500)
        assert len(first) > 5000
        assert canvas.screenshot() != first


@pytest.mark.slow
def test_keyboard_alone(browser: Browser, daemon: Daemon, view: RunningBridge) -> None:
    with opened(browser, view.where) as page:
        page.wait_for_selector("#rows tr")
        page.keyboard.press("Tab")
        page.keyboard.press("Enter")  # "To the read-out"
        assert page.evaluate("document.activeElement.id") == "readout"
        reached = set()
        for _ in range(40):
            page.keyboard.press("Tab")
            reached.add(
                page.evaluate("document.activeElement.id || document.activeElement.className")
            )
        assert {
            "csv",
            "show-drift",
            "tips",
            "use-tip",
            "reload",
            "sound",
            "theme",
            "canvas",
        } <= reached
        before = page.evaluate("document.documentElement.dataset.theme")
        page.keyboard.press("t")
        assert page.evaluate("document.documentElement.dataset.theme") != before
        page.keyboard.press("d")
        assert page.get_attribute("#show-drift", "aria-pressed") == "true"
        page.keyboard.press("s")
        assert page.inner_text("#sound") == "Sound off"
        page.keyboard.press("k")
        assert "No. " in page.inner_text("#picked")
        page.wait_for_function("() => document.querySelectorAll('#rows tr').length > 3")
        page.keyboard.press("A")
        page.click("#shapes button:has-text('plane')")
        page.click("#shapes button:has-text('point')")
        page.wait_for_function("() => document.querySelectorAll('#features li').length === 2")
        for box in page.locator("#features input").all():
            box.check()
        page.wait_for_function(
            "() => /distance .* mm/.test(document.getElementById('related').textContent)"
        )
        page.keyboard.press("Escape")
        assert page.inner_text("#picked") == ""
        page.keyboard.press("?")
        assert page.is_visible("#help")
        assert "No position" in page.inner_text("#meanings")
        page.keyboard.press("Escape")
        assert not page.is_visible("#help")
        with page.expect_download() as taken:
            page.keyboard.press("e")
        rows = list(csv.DictReader(io.StringIO(Path(taken.value.path()).read_text())))
        with armd.connect("SIM-0001", daemon.endpoint) as arm:
            there = {measured["seq"] for measured in arm.past(keys.MEASUREMENT)}
        assert rows
        assert {int(row["seq"]) for row in rows} <= there
        assert taken.value.suggested_filename == "SIM-0001.csv"


@pytest.mark.slow
def test_a_press_is_heard_and_listed(browser: Browser, daemon: Daemon, view: RunningBridge) -> None:
    with daemon.listen() as heard, opened(browser, view.where) as page:
        page.evaluate(
            "window.tones = 0; addEventListener('armd-sound', () => { window.tones += 1; })"
        )
        page.wait_for_timeout(2000)
        page.evaluate("window.tones = 0")
        n = len(heard.json("measurement"))
        heard.wait_for(lambda: len(heard.json("measurement")) > n)
        page.wait_for_function("() => window.tones > 0")
        measured = heard.json("measurement")[n]
        x = f"{measured['position_mm'][0]:.3f}"
        page.wait_for_function(
            "(x) => [...document.querySelectorAll('#rows tr td:nth-child(2)')]"
            ".some((cell) => cell.textContent === x)",
            arg=x,
        )


@pytest.mark.slow
def test_interim_checks_are_shown_and_what_they_say_of_the_arm(
    browser: Browser, arm: SimulatedArm, view: RunningBridge
) -> None:
    change = {
        "between": ["2026-03-05T09:00:00Z", "2026-03-06T09:00:00Z"],
        "cause": "encoder_slip",
        "location": "joint 3",
        "judged_under": "abc",
    }
    with opened(browser, view.where) as page:
        page.get_by_text("day-04, 3.0 h ago: in control").wait_for()
        checked(arm.folder, "changed", change)
        page.get_by_text("day-04, 3.0 h ago: the arm has changed").wait_for()
        page.locator("#state[data-state=INACCURATE]").wait_for()
        assert "encoder slip, joint 3" in page.locator("#state-reason").inner_text()
        page.locator("#events").get_by_text("interim checks say").first.wait_for()
        checked(arm.folder, "in_control")
        page.get_by_text("day-04, 3.0 h ago: in control").wait_for()


def use_tip(page: Page, name: str, told: str) -> None:
    page.select_option("#tips", name)
    page.click("#use-tip")
    wait_for_tip(page, told)


def wait_for_tip(page: Page, told: str) -> None:
    page.wait_for_function(
        "(told) => document.getElementById('tip').textContent.startsWith(told)", arg=told
    )


@pytest.mark.slow
def test_a_tip_is_changed_and_a_calibrated_one_listed_and_put_in_force(
    browser: Browser, view: RunningBridge
) -> None:
    found = {
        "measured": "2026-03-01T09:00:00+00:00",
        "standard_uncertainty_mm": [0.01, 0.01, 0.02],
        "form_error_mm": 0.03,
        "radius_mm": None,
        "moved_mm": 0.1,
    }
    for name, offset_mm, verdict in (
        ("sapphire", [1.0, 0.0, 150.0], "doubtful: a loose tip"),
        ("sapphire", [0.9, 0.0, 150.2], "good"),
        ("loose", [0.0, 0.0, 150.0], "doubtful: a loose tip"),
    ):
        keep("SIM-0001", found | {"name": name, "offset_mm": offset_mm, "verdict": verdict})
    with opened(browser, view.where) as page:
        use_tip(page, "ruby", "ruby, radius 1.500 mm")
        assert "offset 0.000, 0.000, 150.000 mm; since" in page.inner_text("#tip")
        page.focus("#tip-history summary")
        page.keyboard.press("Enter")
        page.wait_for_function("() => document.querySelectorAll('#tip-rows tr').length === 3")
        rows = page.locator("#tip-rows tr").all_inner_texts()
        assert [row.split()[0] for row in rows] == ["loose", "sapphire", "sapphire"]
        assert "0.900, 0.000, 150.200" in rows[1] and "0.040" in rows[1] and "good" in rows[1]
        # The last of a tip alone, and only if it is good.
        assert page.locator("#tip-rows button").count() == 1
        page.click("#tip-rows button")
        wait_for_tip(page, "sapphire, radius")
        assert "offset 0.900, 0.000, 150.200 mm; since" in page.inner_text("#tip")
        use_tip(page, "", "the cal")


@pytest.mark.parametrize("scheme", ["dark", "light"])
@pytest.mark.parametrize("width", [390, 1920])
@pytest.mark.slow
def test_nothing_stands_in_anybodys_way(
    browser: Browser, view: RunningBridge, scheme: Any, width: int
) -> None:
    """axe-core finds nothing serious; nothing is cut off; the figures are on the first screen."""
    height = 844 if width == 390 else 1080
    size: Any = {"width": width, "height": height}
    with opened(browser, view.where, viewport=size, color_scheme=scheme) as page:
        page.wait_for_selector("#rows tr")
        page.wait_for_timeout(1500)
        assert page.evaluate("document.documentElement.dataset.theme") == scheme
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        box = page.locator("#z").bounding_box()
        assert box is not None
        assert box["y"] + box["height"] < height
        assert box["height"] > 24
        OUT.mkdir(exist_ok=True)
        page.screenshot(path=OUT / f"view-{scheme}-{width}.png", full_page=width == 390)
        page.click("#tip-history summary")
        assert nothing_grave(page)
        page.click("#help-open")
        assert nothing_grave(page)


#: Whether an element and all in it is seen whole on the screen, without scrolling.
WHOLE = """(id) => {
  const element = document.getElementById(id), box = element.getBoundingClientRect();
  return box.bottom <= innerHeight && element.scrollHeight <= element.clientHeight;
}"""


@pytest.mark.slow
def test_a_laptop_shows_tip_calibration_and_six_measurements(
    browser: Browser, view: RunningBridge
) -> None:
    """At 1280 × 800, as contract and issue have it; letters, bar and the whole arm as well."""
    with opened(browser, view.where, viewport={"width": 1280, "height": 800}) as page:
        page.wait_for_function("() => document.querySelectorAll('#rows tr').length >= 6")
        page.evaluate("document.getElementById('tip-history').remove()")  # scrolled to when asked
        page.evaluate("document.getElementById('writing').remove()")
        assert page.evaluate(WHOLE, "force")
        list_box = page.locator("#measured .scroll").bounding_box()
        sixth = page.locator("#rows tr").nth(5).bounding_box()
        assert list_box is not None and sixth is not None
        assert sixth["y"] + sixth["height"] <= list_box["y"] + list_box["height"]
        assert page.inner_text("#scale-words").endswith("mm")
        mm = float(page.inner_text("#scale-words").split()[0])
        width = page.evaluate("document.getElementById('scale-bar').getBoundingClientRect().width")
        # Against the picture's own projection: as many millimetres at the middle, across it
        across = page.evaluate(
            "async (mm) => { const { scene } = await import('/main.js'); const c = scene.camera;"
            " const d = c.position.distanceTo(scene.controls.target);"
            " const h = scene.canvas.clientHeight;"
            " return mm * c.projectionMatrix.elements[5] * h / (2 * d); }",
            mm,
        )
        assert width == pytest.approx(across, abs=1.0)
        page.wait_for_function(
            "async () => { const { scene } = await import('/main.js');"
            " return scene.outline?.every((place) => scene.sees(place)); }"
        )
        for letter in "xyz":
            assert page.inner_text(f"#letters .{letter}") == letter.upper()


@pytest.mark.slow
def test_events_that_repeat_stand_once_and_digits_follow_the_uncertainty(
    browser: Browser, view: RunningBridge
) -> None:
    with opened(browser, view.where) as page:
        told = page.evaluate(
            """async () => {
              const { Events } = await import("/lists.js");
              const { millimetres, resolution } = await import("/say.js");
              const list = document.createElement("ol");
              const events = new Events(list, document.createElement("p"));
              for (const [text, ms] of [["a", 1e3], ["b", 2e3], ["b", 3e3], ["b", 4e3], ["a", 5e3]])
                events.add({ text, ms, severity: "info" });
              return {
                lines: [...list.children].map((line) => line.querySelector("span").textContent),
                digits: [0.005, 0.03, 0.3, 3, 30].map((u) => resolution(u)),
                kept: [resolution(0.011, 3), resolution(0.5, 3), resolution(0, 2), resolution(0)],
                words: millimetres(1.23456, 1),
              };
            }"""
        )
        assert [line.split(" ")[0] for line in told["lines"]] == ["a", "b", "a"]
        assert "3 times since" in told["lines"][1]
        assert told["digits"] == [3, 2, 1, 0, 0]
        assert told["kept"] == [3, 1, 2, 3]
        assert told["words"] == "1.2"


def nothing_grave(page: Page) -> bool:
    """Whether axe-core finds nothing serious, and nothing is cut off at the page's side."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(AXE.read_text(encoding="utf-8"))
    found = page.evaluate("axe.run().then((result) => result.violations)")
    grave = [
        (v["id"], [node["html"] for node in v["nodes"]])
        for v in found
        if v["impact"] in ("serious", "critical")
    ]
    assert grave == []
    wide = page.evaluate("document.documentElement.scrollWidth - innerWidth")
    assert wide <= 0, f"{wide} px too wide"
    return True


def tab_to(page: Page, selector: str) -> None:
    """Moves the focus as a person without a mouse does."""
    for _ in range(80):
        page.keyboard.press("Tab")
        if page.evaluate("(selector) => document.activeElement.matches(selector)", selector):
            return
    raise AssertionError(f"{selector} is not reached by Tab")


#: What became of presses and keys, one after another: the next press may come at once.
NOTE_OUTCOMES = """() => {
  window.outcomes = [];
  const outcome = document.getElementById("outcome");
  new MutationObserver(() => window.outcomes.push(outcome.dataset.event))
    .observe(outcome, { attributes: true, attributeFilter: ["data-event"] });
}"""


def wait_for_outcome(page: Page, event: str) -> None:
    """Of now or later; what was before is forgotten."""
    page.wait_for_function("(event) => window.outcomes.includes(event)", arg=event)
    page.evaluate("window.outcomes = []")


@pytest.mark.crowd
@pytest.mark.parametrize(("width", "scheme"), [(390, "dark"), (1920, "light")])
@pytest.mark.slow
def test_a_guided_measurement_by_keyboard_alone(
    browser: Browser, view: RunningBridge, width: int, scheme: Any
) -> None:
    """From the first key to a report, on a telephone and on the wall; axe-core at every step."""
    size: Any = {"width": width, "height": 844 if width == 390 else 1080}
    with opened(browser, view.where, viewport=size, color_scheme=scheme) as page:
        page.wait_for_selector("#begin-open:visible")
        page.keyboard.press("m")
        page.wait_for_selector("#begin[open]")
        page.wait_for_selector("#kinds input", state="attached")
        assert nothing_grave(page)
        tab_to(page, "#kinds input")
        assert page.is_checked("#kinds input[value=seats]")  # by default
        tab_to(page, "[name=name]")
        page.keyboard.type(f"seat {width}")
        page.keyboard.press("Enter")
        page.wait_for_selector("#guide:visible")
        page.evaluate(NOTE_OUTCOMES)
        # The simulated arm wanders and presses here and there: some is taken, much refused.
        wait_for_outcome(page, "reading")
        wait_for_outcome(page, "refused")
        assert nothing_grave(page)
        page.screenshot(path=OUT / f"view-guide-{width}.png", full_page=width == 390)
        page.keyboard.press("a")
        wait_for_outcome(page, "again")
        page.keyboard.press("x")
        wait_for_outcome(page, "deleted")
        tab_to(page, "[data-deed=skip]")
        page.keyboard.press("Enter")
        page.wait_for_function(
            "() => document.getElementById('progress').textContent.includes('1 left out')"
        )
        wait_for_outcome(page, "reading")
        tab_to(page, "[data-deed=finish]")
        page.keyboard.press("Enter")
        page.wait_for_selector("[data-deed=close]:visible", timeout=180_000)
        assert nothing_grave(page)
        tab_to(page, "#results a[href$='session.toml']")
        with page.context.expect_page() as other:
            page.keyboard.press("Enter")
        other.value.wait_for_url(f"**/sessions/seat%20{width}/session.toml")
        assert 'arm = "SIM-0001"' in other.value.inner_text("body")
        other.value.close()
        tab_to(page, "[data-deed=close]")
        page.keyboard.press("Enter")
        page.wait_for_selector("#guide", state="hidden")


@pytest.mark.slow
def test_daemon_and_view_go_and_come_without_a_reload(browser: Browser, tmp_path: Path) -> None:
    endpoint = free_endpoint()
    with (
        simulated_arm(tmp_path, seconds=300) as arm,
        running_daemon(tmp_path, arm.port, endpoint=endpoint) as daemon,
        viewing(endpoint) as view,
        opened(browser, view.where) as page,
    ):
        page.evaluate("window.loadedOnce = true")
        page.wait_for_selector("#rows tr")
        daemon.process.kill()
        daemon.process.wait()
        page.wait_for_function(
            "() => document.getElementById('state-word').textContent === 'No daemon'"
        )
        assert "no point for" in page.inner_text("#held")
        assert page.evaluate("document.getElementById('readout').classList.contains('old')")
        page.screenshot(path=OUT / "view-no-daemon.png")
        with running_daemon(tmp_path, arm.port, endpoint=endpoint):
            began_s = time.monotonic()
            live(page)
            print(f"live again {time.monotonic() - began_s:.1f} s after the daemon")
            where = view.where
            view.process.kill()
            view.process.wait()
            page.wait_for_function(
                "() => document.getElementById('state-word').textContent === 'No connection'"
            )
            with viewing(endpoint, listen=where):
                live(page)
                page.wait_for_selector("#rows tr")
                assert page.evaluate("window.loadedOnce") is True
                assert page.evaluate(
                    "new Set([...document.querySelectorAll('#rows tr')]"
                    ".map((row) => row.dataset.id)).size"
                    " === document.querySelectorAll('#rows tr').length"
                )
                # Read-only: there is nothing to do.
                assert not page.is_visible("#writing")


# --- guided measuring ------------------------------------------------------------------------

WALL: Any = {"width": 1920, "height": 1080}
BEAM = '[artefact]\nname = "beam"\n' + "".join(
    f'[[artefact.target]]\nname = "{name}"\nposition_mm = {list(where)}\n'
    for name, where in {
        "B1": (0.0, 0.0, 0.0),
        "B2": (150.0, 0.0, 0.0),
        "B3": (300.0, 0.0, 60.0),
        "B4": (450.0, 0.0, 0.0),
        "B5": (220.0, 180.0, 90.0),
    }.items()
)
PLACEMENTS, ROUNDS = ("P1", "P2", "P3"), 1
OPERATOR = """\
schema = "armd.operator/1"
artefact = "beam.toml"
rest_s = 1.3
press_after_s = 1.0
haste = 2.5
start_s = 2.5
""" + "".join(f'\n[[visit]]\nplacement = "{name}"\nrounds = {ROUNDS}\n' for name in PLACEMENTS)


DONE_OR_ASTRAY = """() =>
  document.getElementById("next-target").textContent.startsWith("everything")
  || /delete (it|the reading)/.test(document.getElementById("outcome").textContent)"""


def measured_to_the_end(page: Page) -> None:
    """The hand goes its rounds whatever the page says; of a press that was not heard, on a machine
    too busy, the page tells which reading is wrong for it, and that is deleted as by a person."""
    for _ in range(5 * len(PLACEMENTS) * ROUNDS):
        try:
            page.wait_for_function(DONE_OR_ASTRAY, timeout=120_000)
        except PageTimeout as error:
            raise AssertionError(page.inner_text("#guide")) from error
        if page.inner_text("#next-target").startswith("everything"):
            return
        so_far = page.inner_text("#progress")
        page.click("[data-deed=delete]")
        page.wait_for_function(
            "(before) => document.getElementById('progress').textContent !== before", arg=so_far
        )
    raise AssertionError(page.inner_text("#guide"))


@pytest.mark.crowd
@pytest.mark.slow
def test_an_artefact_is_measured_to_its_end(browser: Browser, tmp_path: Path) -> None:
    """Begun, led, killed, gone on with, one deleted, finished: the disk has what the page said."""
    sessions = tmp_path / "sessions"
    sessions.mkdir()
    for folder in (tmp_path, sessions):
        (folder / "beam.toml").write_text(BEAM)
    (tmp_path / "plan.toml").write_text(OPERATOR)
    with simulated_arm(tmp_path, link=True, seconds=2) as arm:  # so that the port is there
        arm.wait()
    with running_daemon(tmp_path, arm.port) as daemon, ExitStack() as stack:
        options = ("--allow-commands", "--sessions", str(sessions))
        view = stack.enter_context(viewing(daemon.endpoint, *options))
        page = stack.enter_context(opened(browser, view.where, wait=False, viewport=WALL))
        page.wait_for_selector("#begin-open:visible")
        page.keyboard.press("m")
        page.check("#kinds input[value=artefact]")
        page.fill("[name=name]", "../escape")
        page.click("#begin-form button.main")
        assert page.is_visible("#begin")  # the field itself refuses it
        page.fill("[name=name]", "beam in May")
        page.select_option("#artefacts", "beam.toml")
        page.fill("[name=placements]", ",".join(PLACEMENTS))
        page.fill("[name=repeats]", str(ROUNDS))
        page.fill("[name=artefact_c]", "20.4")
        page.keyboard.press("Enter")
        page.wait_for_selector("#guide:visible")
        assert page.inner_text("#progress") == "0 of 15"
        # The hand begins when it is told what to touch, as a person does.
        # Numbered on: from 0 again, the samples would be taken for repeated ones.
        (tmp_path / "boot.toml").write_text("first_seq = 1000000\n")
        operator = ("--operator", str(tmp_path / "plan.toml"))
        operator += ("--scenario", str(tmp_path / "boot.toml"))
        stack.enter_context(simulated_arm(tmp_path, *operator, link=True, seconds=400))
        page.wait_for_function("() => document.getElementById('bar').value > 0.2")
        # Where to go is known after three balls, and how far it is changes as the hand moves.
        page.wait_for_function("() => / mm/.test(document.getElementById('away').textContent)")
        away = page.inner_text("#away")
        page.wait_for_function(
            "(away) => document.getElementById('away').textContent !== away", arg=away
        )
        page.screenshot(path=OUT / "view-guided-1920.png")
        measured_to_the_end(page)
        # The view is killed: nothing that was told as taken is lost.
        where = view.where
        view.process.kill()
        view.process.wait()
        stack.enter_context(viewing(daemon.endpoint, *options, listen=where))
        page.wait_for_selector("#guide", state="hidden")
        live(page)
        page.click("#begin-open")
        page.click("#sessions button")
        page.wait_for_selector("#guide:visible")
        assert page.inner_text("#progress") == "15 of 15"
        page.click("[data-deed=delete]")
        page.wait_for_function(
            "() => document.getElementById('progress').textContent === '14 of 15'"
        )
        assert page.inner_text("#next-target") == "B5"
        page.click("[data-deed=finish]")
        page.wait_for_selector("[data-deed=close]:visible", timeout=180_000)
        said = page.inner_text("#results")
        assert "armd calibrate" in said
        with page.context.expect_page() as tab:
            page.click("#results a:has-text('calibrate.html')")
        report = tab.value
        report.wait_for_selector("h1")
        assert "SIM-0001" in report.inner_text("body")
        report.close()
        page.screenshot(path=OUT / "view-result-1920.png")
        page.click("[data-deed=close]")
        page.wait_for_selector("#guide", state="hidden")
    session = load_session(sessions / "beam in May", load_arm(arm.arm_toml))
    assert len(session.target) == 5 * len(PLACEMENTS) * ROUNDS - 1
    assert (sessions / "beam in May" / "calibration.json").is_file()
