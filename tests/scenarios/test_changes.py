"""What others do to a daemon that measures: reloads of any file, storms of them, floods of
questions. The stream loses nothing, and every point is made with the calibration it names."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import zenoh

from armd import Flag
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import save_calibration
from armd.compensation.model.pose_factors import Harmonic
from armd.compensation.model.slow_factors import Time
from armd.compensation.model.terms import Term
from support.drawn import drawn
from support.punctuality import Punctuality
from support.running_daemon import Daemon, Heard, running_daemon
from support.simulated_arm import simulated_arm
from support.spoilt_files import fifo, loop, nest

EXTRA = "[commands]\nenabled = true\n"
DAY_S = 86_400.0

pytestmark = pytest.mark.serial  # that nothing is lost meanwhile


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("changes")


@pytest.fixture(scope="module")
def daemon(folder: Path) -> Iterator[Daemon]:
    with simulated_arm(folder) as arm:
        write(folder / "calibration.json")
        top = 'calibration = "calibration.json"'
        with running_daemon(folder, arm.port, extra=EXTRA, top=top) as daemon:
            yield daemon


@pytest.fixture
def heard(daemon: Daemon) -> Iterator[Heard]:
    with daemon.listen() as heard:
        heard.wait_for(lambda: len(heard.points()) > 200)
        yield heard


def write(path: Path, d_1_mm: float = 0.0, terms: list[Term] | None = None) -> int:
    """A calibration *d_1_mm* longer than the drawing, put in place atomically; its identity."""
    arm = load_arm(path.parent / "arm.toml")
    return save_calibration(path, drawn(arm, d_1_mm, terms=terms or [])).identity


@contextmanager
def nothing_lost(heard: Heard) -> Iterator[None]:
    """Whatever happens meanwhile, and for a tenth of a second after it."""
    first = len(heard.points()) - 1
    with Punctuality().watch() as machine:
        yield
        seen = len(heard.points())
        heard.wait_for(lambda: len(heard.points()) > seen + 100)
    machine.judge_gaps(heard.points()["seq"][first:], "points beside a change")


def test_a_reload_of_thousands_of_terms_loses_no_sample(
    daemon: Daemon, heard: Heard, folder: Path
) -> None:
    terms = [
        Term(parameter="a_2", basis=[Harmonic(kind="sin", joint=1, order=1 + i % 64)])
        for i in range(5000)
    ]
    identity = write(folder / "calibration.json", terms=terms)
    with nothing_lost(heard):
        ok, reply = daemon.get("command/reload")
        assert ok and reply["done"].startswith("calibration ")
        heard.wait_for(lambda: int(heard.points()["calibration"][-1]) == identity)
    sha256 = daemon.get("info")[1]["calibration"]["sha256"]
    assert int.from_bytes(bytes.fromhex(sha256)[:8], "little") == identity
    assert sha256 in reply["done"] and heard.events("calibration")[-1]["text"].endswith(sha256)
    write(folder / "calibration.json")
    assert daemon.get("command/reload")[0]


def test_in_a_storm_of_reloads_every_point_is_made_with_the_calibration_it_names(
    daemon: Daemon, heard: Heard, folder: Path
) -> None:
    path = folder / "calibration.json"
    lifted_mm = {write(path, d_1_mm): d_1_mm for d_1_mm in (0.0, 50.0)}
    assert daemon.get("command/reload")[0]
    first = len(heard.points())
    contents = [path.read_bytes()]
    write(path, 0.0)
    contents.append(path.read_bytes())
    end_s = time.monotonic() + 1.5
    new = folder / "new.json"
    with daemon.session() as session, nothing_lost(heard):
        for i in range(10**6):
            new.write_bytes(contents[i % 2])
            new.replace(path)
            session.get("armd/SIM-0001/command/reload", lambda _: None, timeout=30.0)
            time.sleep(0.002)
            if time.monotonic() > end_s:
                break
    points = heard.points()[first:]
    lifts = np.array([lifted_mm[int(identity)] for identity in points["calibration"]])
    changes = np.flatnonzero(np.diff(lifts))
    assert len(changes) > 2
    z = points["position_mm"][:, 2]
    # Between two samples the arm itself moves by a millimetre or two.
    np.testing.assert_allclose(np.diff(z)[changes], np.diff(lifts)[changes], atol=5.0)
    still = np.diff(lifts) == 0
    assert np.abs(np.diff(z)[still]).max() < 5.0


def too_many_terms(path: Path) -> None:
    content = json.loads(path.read_text())
    content["terms"] = [{"parameter": "a_2", "basis": [], "coefficient": 1e-9}] * 20_000
    path.write_text(json.dumps(content))


@pytest.mark.parametrize(
    ("spoil", "found"),
    [
        (nest, "brackets in brackets"),
        (lambda path: path.write_text("9" * 5000), "thousands of digits"),
        (loop, "leads back to itself"),
        (fifo, "a pipe"),
        (too_many_terms, "at most"),
        (lambda path: path.unlink(), "found nothing"),
        (
            lambda path: path.write_text(path.read_text().replace('"d_1": ', '"d_1": 1')),
            "content_sha256",
        ),
        (lambda path: path.write_bytes(b"\xff" * 20_000_000), "20000000 bytes"),
    ],
    ids=["nested", "digits", "loop", "fifo", "terms", "gone", "edited", "large"],
)
def test_whatever_is_wrong_with_a_file_the_old_calibration_stays(
    daemon: Daemon, heard: Heard, folder: Path, spoil: Callable[[Path], None], found: str
) -> None:
    path = folder / "calibration.json"
    identity = int(heard.points()["calibration"][-1])
    try:
        with nothing_lost(heard):
            spoil(path)
            ok, reply = daemon.get("command/reload")
        assert not ok and found in reply
        heard.wait_for(
            lambda: any(found in told["text"] for told in heard.events("calibration_refused"))
        )
        assert int(heard.points()["calibration"][-1]) == identity
    finally:
        path.unlink(missing_ok=True)
        write(path)
        assert daemon.get("command/reload")[0]


def test_a_term_that_follows_time_is_held_outside_its_period_and_says_so(
    daemon: Daemon, heard: Heard, folder: Path
) -> None:
    path = folder / "calibration.json"
    since_s = time.time() - 10 * DAY_S
    drift = Time(since_unix_s=since_s, until_unix_s=since_s + DAY_S)
    identity = write(path, terms=[Term(parameter="d_1", basis=[drift], coefficient=0.005)])
    assert daemon.get("command/reload")[0]
    heard.wait_for(lambda: int(heard.points()["calibration"][-1]) == identity)
    point = heard.points()[-1]
    np.testing.assert_allclose(point["correction_mm"], [0, 0, 0.005 * 24], atol=1e-6)
    assert point["flags"] & Flag.TEMPERATURE_RANGE and not point["flags"] & Flag.INVALID
    heard.wait_for(
        lambda: any(
            "follows time was identified" in health["reason"] and health["state"] == "INACCURATE"
            for health in heard.json("health")
        )
    )
    write(path)
    assert daemon.get("command/reload")[0]


def test_a_flood_of_questions_does_not_starve_the_stream(daemon: Daemon, heard: Heard) -> None:
    answered: list[zenoh.Reply] = []
    with daemon.session() as session, nothing_lost(heard):
        time.sleep(0.1)
        for what in ("event",) * 1000 + ("info", "health", "command/reload") * 100:
            session.get(f"armd/SIM-0001/{what}", answered.append, timeout=30.0)
        time.sleep(1.0)
        assert daemon.get("health")[0]
        assert daemon.get("info")[0]
    assert any(reply.ok is not None for reply in answered)
