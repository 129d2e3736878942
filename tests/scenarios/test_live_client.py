"""The Python client in a process of its own, beside a simulated arm and a daemon in theirs."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest

from support.pages import page_path
from support.running_daemon import Daemon, running_daemon
from support.simulated_arm import SimulatedArm, simulated_arm

PAGE = page_path("python")
#: Prints one JSON object: what each kind of call gave.
PROGRAM = """
import asyncio, json, sys, threading
import armd

async def some(arm, n):
    found = []
    async for point in arm.points_async():
        found.append([point.seq, *point.position_mm])
        if len(found) == n:
            return found

arm = armd.connect(endpoint=sys.argv[1])
pressed = []
handle = arm.on_measurement(pressed.append, past=True)
said = {
    "iterator": [[p.seq, *p.position_mm] for p in arm.points(seconds=0.5)],
    "async": asyncio.run(some(arm, 50)),
    "lost": arm.lost.total,
    "latest": [(point := arm.latest(60.0)).seq, *point.position_mm],
    "state": arm.state(),
    "history": arm.past("measurement"),
}
handle.close()
said["pressed"] = pressed
threading.Timer(0.3, arm.close).start()
said["until closed"] = sum(1 for _ in arm.points())
try:
    arm.latest(60.0)
except armd.Closed as error:
    said["closed"] = str(error)
print(json.dumps(said))
"""


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[SimulatedArm, Daemon]]:
    folder = tmp_path_factory.mktemp("live")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STATE_DIRECTORY", str(folder / "state"))
        with simulated_arm(folder, rate_hz=200) as arm, running_daemon(folder, arm.port) as daemon:
            yield arm, daemon


def run(program: str, *arguments: str) -> str:
    command = [sys.executable, "-c", program, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def test_each_kind_of_call_gives_what_the_daemon_publishes(
    live: tuple[SimulatedArm, Daemon],
) -> None:
    """The truth is a plain Zenoh subscription to the same daemon."""
    _, daemon = live
    with daemon.listen() as heard:
        heard.wait_for(lambda: heard.json("measurement"))
        said = json.loads(run(PROGRAM, daemon.endpoint))
        last = said["latest"][0]
        heard.wait_for(lambda: heard.points()["seq"][-1] >= last)
        published = {int(p["seq"]): p["position_mm"] for p in heard.points()}
        measured = heard.json("measurement")
    for points in (said["iterator"], said["async"], [said["latest"]]):
        seq = [point[0] for point in points]
        assert seq == list(range(seq[0], seq[0] + len(seq)))  # none lost, in order
        for number, *position in points:
            np.testing.assert_array_equal(position, published[number])
    assert said["lost"] == 0 and len(said["async"]) == 50 and said["until closed"] > 0
    assert {"state", "reason", "rates"} <= said["state"].keys()
    assert said["closed"] == "the connection to the arm is closed"
    for told in (said["history"], said["pressed"]):
        assert told and [m["seq"] for m in told] == sorted(m["seq"] for m in told)
    by_seq = {m["seq"]: m for m in said["history"]}
    assert all(by_seq.get(m["seq"], m) == m for m in measured)


def test_the_page_runs_beside_an_arm(live: tuple[SimulatedArm, Daemon]) -> None:
    """As written, but for the port."""
    _, daemon = live
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (program,) = (block for block in blocks if "armd.connect(" in block)
    said = run(program.replace("connect()", f"connect(endpoint={daemon.endpoint!r})"))
    first, *_, last = said.splitlines()
    assert re.fullmatch(r"<armd\.Arm SIM-0001> [A-Z_]+ \((-?\d+\.\d+(, )?){3}\)", first)
    assert re.fullmatch(r"\d+ \d+ \d+ 0", last)


@pytest.mark.slow
def test_no_point_in_time_is_no_answer_though_the_daemon_answers(
    live: tuple[SimulatedArm, Daemon],
) -> None:
    """The last test of this file: the arm is gone after it."""
    arm, daemon = live
    arm.stop()
    said = run(
        "import sys, armd\n"
        "with armd.connect(endpoint=sys.argv[1]) as arm:\n"
        "    while True:\n"
        "        try:\n"
        "            arm.latest(0.5)\n"
        "        except TimeoutError as error:\n"
        "            print(error, '|', arm.info()['arm']['serial_number'])\n"
        "            break\n",
        daemon.endpoint,
    )
    assert said == "SIM-0001: no point within 0.5 s | SIM-0001\n"
