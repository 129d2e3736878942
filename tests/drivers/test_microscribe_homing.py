"""A MicroScribe whose homing was lost: what makes a press believed, over the wire and by itself."""

from __future__ import annotations

import json
import multiprocessing
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import pytest

from armd.compensation.model.kinematics import compute_pose
from armd.drivers.config import MicroScribeConfig
from armd.drivers.microscribe.decoder import MicroScribeDecoder
from armd.drivers.microscribe.driver import MicroScribeDriver
from armd.drivers.microscribe.homing import Before, Homing
from armd.drivers.sample import Event, Item, RawFrame
from armd.simulator.live.faults import Fault
from armd.simulator.live.pty_port import PtyPort
from armd.simulator.live.scenario import Scenario
from armd.simulator.live.truth_log import FaultLog, TruthFile
from armd.simulator.microscribe import arm
from armd.simulator.microscribe.device import MicroScribeDevice
from support.microscribe import EXPECTED, TURNS, nominal
from support.sampled import events_of, rows_of
from support.selection import parametrize_default

S = 1_000_000_000
HOME = arm.HOME_COUNTS / arm.COUNTS_PER_TURN * 2 * np.pi
AWAY = HOME + np.radians([40.0, -25.0, 30.0, 20.0, -15.0])
LIFTED = HOME + np.radians([0.0, 8.0, 0.0, 0.0, 0.0])
BESIDE = HOME + np.radians([0.0, 2.0, 0.0, 0.0, 0.0])


class ScriptedHand:
    """*poses*: (second, angles) in order, moved to steadily in the second before; *presses*: s."""

    PRESS_S = 0.4

    def __init__(self, poses: list[tuple[float, np.ndarray]], presses: list[float]) -> None:
        self._poses, self._presses = [(0.0, HOME), *poses], presses

    def note_home(self, t_s: float) -> None:
        pass

    def angles(self, t_s: float) -> np.ndarray:
        angles = HOME
        for at_s, pose in self._poses[1:]:
            angles = angles + np.clip(t_s - at_s + 1.0, 0.0, 1.0) * (pose - angles)
        return angles

    def buttons(self, t_s: float) -> int:
        return int(any(at_s <= t_s < at_s + self.PRESS_S for at_s in self._presses))


@contextmanager
def living(folder: Path, hand: ScriptedHand, fault: Fault, seconds: float) -> Iterator[Path]:
    """A simulated arm in that hand, on a pseudo-terminal; its port's lasting name."""
    process = multiprocessing.get_context("fork").Process(
        target=_live, args=(folder, hand, Scenario(seconds=seconds, fault=[fault]))
    )
    process.start()
    try:
        while not (folder / "port").is_symlink():
            time.sleep(0.01)
        yield folder / "port"
    finally:
        process.terminate()
        process.join()


def _live(folder: Path, hand: ScriptedHand, scenario: Scenario) -> None:
    with (
        closing(TruthFile(None)) as truth,
        closing(FaultLog(folder / "faults.jsonl")) as log,
        closing(PtyPort(folder / "port")) as port,
        closing(MicroScribeDevice(scenario, port, truth, log, None, hand)) as device,
    ):
        device.run()


def read(port: Path, seconds: float) -> tuple[list[Item], list[RawFrame], int]:
    """Items and frames of so many seconds, and when the simulator began to live."""
    items: list[Item] = []
    raw: list[RawFrame] = []
    config = MicroScribeConfig(kind="microscribe", port=str(port), baud=115_200)
    with closing(MicroScribeDriver(config, EXPECTED)) as driver:
        end_ns = time.monotonic_ns() + round(seconds * S)
        while time.monotonic_ns() < end_ns:
            items += driver.read(0.05)
            raw += driver.take_raw()
    told = [json.loads(line) for line in (port.parent / "faults.jsonl").read_text().splitlines()]
    begin = next(line for line in told if line["event"] == "begin")
    return items, raw, round(begin["monotonic_ns"] - begin["at_s"] * S)


def farthest_mm(rows: np.ndarray, hand: ScriptedHand, began_ns: int) -> float:
    """Of a valid point from every place where the tip was within 0.1 s of its stamp."""
    valid = rows[rows["joint_invalid"] == 0]
    tips = compute_pose(valid["count"] / np.array(TURNS) * 2 * np.pi, nominal().nominal())[0]
    at_s = (valid["monotonic_ns"] - began_ns) / S
    near = [
        np.linalg.norm(
            [tip - arm.compute_tip_mm(hand.angles(t + d)) for d in np.linspace(-0.1, 0.1, 9)],
            axis=1).min()
        for tip, t in zip(tips[::5], at_s[::5], strict=True)
    ]  # fmt: skip
    return max(near)


@pytest.mark.slow
@parametrize_default("fault", ["unplug", "reboot"])
def test_a_press_away_from_the_rest_gives_no_wrong_point(tmp_path: Path, fault: str) -> None:
    """Somebody measures on who has not seen that the plug came out, or the power."""
    MicroScribeDecoder(EXPECTED).warm_up()
    poses = [(4.0, AWAY), (10.0, HOME), (13.0, LIFTED), (14.5, HOME), (17.5, AWAY)]
    hand = ScriptedHand(poses, presses=[2.0, 7.5, 11.5, 16.0])
    with living(tmp_path, hand, Fault(name=fault, at_s=5.0, duration_s=0.4), 20.0) as port:
        items, raw, began_ns = read(port, 19.0)
    told = [i for i in items if isinstance(i, Event) and i.kind.startswith("home")]
    assert [event.kind for event in told] == [
        "homed", "home_unconfirmed", "home_unconfirmed", "homed",
    ]  # fmt: skip
    assert "lift the stylus, put it back into its rest" in told[1].text
    reason = {"unplug": "joint 1 is 40.0° from where it was", "reboot": "may have been off"}[fault]
    assert reason in told[1].text
    rows = rows_of(items)
    at_s = (rows["monotonic_ns"] - began_ns) / S
    valid = rows["joint_invalid"] == 0
    assert not valid[(at_s > 5.5) & (at_s < 16.0)].any()
    assert valid[at_s > 17.0].sum() > 100
    assert farthest_mm(rows, hand, began_ns) < 3.0  # while it moves: a pseudo-terminal's instants
    decoder = MicroScribeDecoder(EXPECTED)
    again = [item for frame in raw for item in decoder.feed(frame)]
    assert np.array_equal(rows_of(again), rows)
    assert [kind for kind in events_of(again) if kind.startswith("home")] == [e.kind for e in told]


@pytest.mark.slow
def test_an_arm_that_kept_its_power_is_homed_by_one_press_in_its_rest(tmp_path: Path) -> None:
    MicroScribeDecoder(EXPECTED).warm_up()
    hand = ScriptedHand([(4.0, AWAY), (6.5, HOME)], presses=[2.0, 8.5])
    with living(tmp_path, hand, Fault(name="unplug", at_s=5.0, duration_s=0.4), 11.0) as port:
        items, _, began_ns = read(port, 10.0)
    assert [kind for kind in events_of(items) if kind.startswith("home")] == ["homed", "homed"]
    rows = rows_of(items)
    valid = rows[rows["joint_invalid"] == 0]
    assert (valid["monotonic_ns"] > began_ns + 8.5 * S).sum() > 100
    assert farthest_mm(rows, hand, began_ns) < 3.0


# --- homing by itself ------------------------------------------------------------------------


class Session:
    """Readings of a second session, 10 ms apart; the timer runs on unless it is *off_ms*."""

    def __init__(self, gap_s: float = 5.0, off_ms: float = 0.0) -> None:
        self.homing = Homing(TURNS, Before(counts_of(HOME), 0, 16_000))
        self._at_ns, self._off_ms = round(gap_s * S), off_ms

    def stand(self, angles: np.ndarray, seconds: float, pressed: bool = False) -> str:
        said = ""
        for _ in range(round(seconds * 100)):
            self._at_ns += S // 100
            ticks = 16_000 + round((self._at_ns / 1e9 + self._off_ms / 1e3) * 900)
            buttons = int(pressed)
            said += self.homing.watch(counts_of(angles), buttons, self._at_ns, ticks % (1 << 14))
            if self.homing.is_due(self._at_ns):
                self.homing.note_sent()
                self.homing.acknowledged()
        return said

    def press(self, angles: np.ndarray, rest_s: float = 0.6) -> str:
        return self.stand(angles, rest_s) + self.stand(angles, 0.1, pressed=True)


def counts_of(angles: np.ndarray) -> tuple[int, ...]:
    return tuple(np.round(angles / (2 * np.pi) * TURNS).astype(int).tolist())


@pytest.mark.parametrize(
    ("gap_s", "off_ms", "is_enough"),
    [(0.5, 0, True), (5, 4, True), (60, -8, True), (95, 12, True), (18.2, 0, True),
     (0.5, 8, False), (5, 3000, False), (60, -20, False), (101, 0, False), (600, 0, False)],
)  # fmt: skip
def test_one_press_is_enough_if_the_timer_ran_on_and_not_for_too_long(
    gap_s: float, off_ms: float, is_enough: bool
) -> None:
    session = Session(gap_s, off_ms)
    assert session.press(HOME) == "" and session.homing.homed == is_enough
    assert session.homing.unconfirmed != is_enough
    assert is_enough or "may have been off" in session.homing.doubt


@pytest.mark.parametrize("pose", [AWAY, BESIDE])
@pytest.mark.parametrize("off_ms", [0.0, 3000.0])
def test_only_what_is_lifted_and_comes_back_is_a_rest(pose: np.ndarray, off_ms: float) -> None:
    session = Session(off_ms=off_ms)
    session.press(pose)
    assert session.homing.unconfirmed
    assert "not lifted" in session.press(pose)  # pressed again because nothing happened
    session.stand(pose + np.radians([3.0, 3.0, 3.0, 3.0, 3.0]), 1.0)
    assert "not lifted" in session.press(pose)
    session.stand(pose + np.radians([0.0, 0.0, 6.0, 0.0, 0.0]), 1.0)
    session.press(pose + np.radians([0.0, 0.0, 0.0, 1.0, 0.0]))  # a hand's
    assert session.homing.unconfirmed and not session.homing.homed
    session.stand(pose + np.radians([0.0, 0.0, 6.0, 1.0, 0.0]), 1.0)
    assert session.press(pose + np.radians([0.0, 0.0, 0.2, 1.2, 0.0])) == ""
    assert session.homing.homed and not session.homing.unconfirmed


def test_home_sent_once_makes_the_counts_those_of_no_session_before() -> None:
    session = Session()
    session.press(AWAY)
    session.press(HOME)  # its rest at last, in a frame of which nothing is known any more
    assert session.homing.unconfirmed and "may have been off" in session.homing.doubt


def test_what_is_known_outlives_sessions_that_are_not_homed() -> None:
    session = Session()
    assert session.homing.lost() == Before(counts_of(HOME), 0, 16_000)
    session.press(HOME)
    session.homing.follow(counts_of(HOME), 77, 5)
    session.homing.follow(counts_of(AWAY), 99, 7)
    assert session.homing.lost() == Before(counts_of(HOME), 99, 7)
    again = Homing.restored(session.homing.state())
    assert again == session.homing and again.lost() == session.homing.lost()


def test_a_recording_of_an_earlier_version_is_restored() -> None:
    """Recordings have the fields by their names, which therefore stay."""
    recorded = {
        "counts_per_turn": [40000] * 5, "before": [[1, 2, 3, 4, 5], 7, None], "homed": True,
        "unconfirmed": False, "_home": [1, 2, 3, 4, 5], "_last": [9, None],
        "_rest": [1, 2, 3, 4, 5],
        "_rest_since_ns": 3, "_buttons": 0, "_pressed_ns": None, "_asked": True, "_doubt": "",
        "_lifted": False, "_quickest_ns": None, "_ran_on": False,
    }  # fmt: skip
    restored = Homing.restored(recorded)
    assert restored.homed and restored.before == Before([1, 2, 3, 4, 5], 7, None)
    assert set(restored.state()) == set(recorded)
