"""What the pages about bridges show is run, beside one simulated arm.

Addresses and files become this test's; who serves for ever is used as the page says, and ended.
A command of a page that has no test here fails the first one.
"""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import armd
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import save_calibration
from support.careless_network import session
from support.drawn import drawn
from support.pages import page_path
from support.program import run_armd
from support.running_bridge import RunningBridge, running_bridge
from support.running_daemon import Daemon, free_endpoint, running_daemon
from support.simulated_arm import simulated_arm
from support.waiting import PATIENCE_S, wait_until

PAGES = ["ippdme", "ros2", "fleet", "record-export", "interim", "import", "view"]
#: Commands that these pages show, too, and that other tests run.
NOT_HERE = ("record", "replay", "interim", "measure", "check", "simulate", "calibrate")
CONFIG = """
[commands]
enabled = true
[tips.ball3]
offset_mm = [0.0, 0.0, 120.0]
"""
#: Who keeps serving, by how the page starts it: `serving` starts each, a test uses it.
SERVING = [
    "armd stream",
    "armd stream --template '{x:.3f};{y:.3f};{z:.3f};{u_x_um:.1f}'",
    "armd stream --points 100 --format csv",
    "armd ippdme",
    "armd ippdme --listen 192.0.2.10:1294 --alias PROBE1.TIP1A0B0=ball3",
    "armd ippdme --listen 192.0.2.10:1294",
    "armd ros2 --router tcp/ros-host.example:7447",
    "armd fleet --endpoint tcp/plant.example:7447 --metrics 127.0.0.1:9470",
    "armd view",
    "armd view --allow-commands",
]
#: Those that end by themselves, in this order, and what each must leave behind.
DONE = {
    "armd ros2 --urdf arm.urdf": "arm.urdf",
    "armd export -o points.csv": "points.csv",
    "armd export --log --since 2026-03-01 -o part.qif": "part.qif",
    "armd export measured.jsonl -o points.xyz": "points.xyz",
    "armd recorrect measured.jsonl --arm arm.toml --calibration calibration-2.json"
    " --since 2026-03-03T07:30 --tolerance 0.05 -o again.csv --report again.html": "again.html",
}
FOR_EVER = [  # with --seconds 3, so that they end
    "armd fleet --endpoint tcp/plant.example:7447",
    "armd fleet --endpoint tcp/plant.example:7447 --json",
]
ELSEWHERE = {
    "armd export recording.mcap -o drawn.mcap": "test_export_foxglove.py",
    "armd init my-arm --from so101": "test_import_page.py",
    "armd init drawn-arm --from drawing.csv --serial-number MY-ARM"
    " --port /dev/ttyUSB0": "test_import_page.py",
    "armd import readings.csv --arm my-arm/arm.toml -o measured": "test_import_page.py",
    "armd import readings.xlsx --sheet Data --column q1='Base axis' --angle-unit deg"
    " --arm my-arm/arm.toml -o from-excel": "test_import_page.py",
    "armd import robot.urdf -o arm.toml": "test_import_page.py",
    "armd import joints.csv --points tracker.csv --arm my-arm/arm.toml"
    " -o tracked": "test_import_page.py",
    "armd import my-dataset --arm my-arm/arm.toml --lerobot follower.json"
    " -o from-lerobot": "test_import_page.py",
    "armd arm so100 -o so100.toml": "test_import_page.py",
    "armd import episode.json --servo-zeros so-100_config.json --arm so100.toml"
    " -o from-phosphobot": "test_import_page.py",
    "armd import rosbag2_2026_03_01 --arm my-arm/arm.toml -o from-ros": "test_import_page.py",
    "armd fleet --router plant-router.json5": "test_fleet.py: it needs certificates",
    "armd view --listen 192.0.2.10:8470 --name controller.example --certificate controller.pem"
    " --key controller.key --token token": "test_view.py: likewise",
}


def commands(name: str) -> list[list[str]]:
    text = page_path(name).read_text(encoding="utf-8")
    blocks = "\n".join(re.findall(r"```sh\n(.*?)```", text, re.DOTALL)).replace("\\\n", " ")
    return [shlex.split(line, comments=True) for line in blocks.splitlines() if "armd " in line]


@dataclass
class Place:
    folder: Path
    daemon: Daemon
    router: str
    """Of a ROS that is not there."""


def test_every_command_of_the_pages_is_here() -> None:
    typed = [words for name in PAGES for words in commands(name)]
    shown = {shlex.join(words) for words in typed if words[1] not in NOT_HERE}
    here = [*SERVING, *DONE, *FOR_EVER, *ELSEWHERE]
    assert shown == {shlex.join(shlex.split(line)) for line in here}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    folder = tmp_path_factory.mktemp("pages")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STATE_DIRECTORY", str(folder / "state"))
        patch.chdir(folder)
        with (
            simulated_arm(folder) as arm,
            running_daemon(folder, arm.port, extra=CONFIG) as daemon,
            daemon.listen() as heard,
            zenoh_router() as router,
        ):
            heard.wait_for(lambda: len(heard.json("measurement")) > 2)
            yield Place(folder, daemon, router)


@contextmanager
def zenoh_router() -> Iterator[str]:
    endpoint = free_endpoint()
    with session("router", endpoint):
        yield endpoint


def here(line: str, place: Place) -> list[str]:
    """The command's words without `armd`, with this test's addresses."""
    own = ("127.0.0.1:0", place.daemon.endpoint)
    text = re.sub(r"192\.0\.2\.10:1294|127\.0\.0\.1:9470", own[0], line)
    text = text.replace("tcp/plant.example:7447", own[1])
    words = shlex.split(text.replace("tcp/ros-host.example:7447", place.router))[1:]
    if words[0] in ("stream", "ippdme", "view") and "--listen" not in words:
        words += ["--listen", own[0]]
    live = "measured.jsonl" not in words and "--log" not in words
    return words if "--endpoint" in words or not live else [*words, "--endpoint", own[1]]


@contextmanager
def serving(line: str, place: Place) -> Iterator[RunningBridge]:
    name, *options = here(line, place)
    with running_bridge(name, *options) as bridge:
        yield bridge
        assert bridge.stop() == 0


def a_line(bridge: RunningBridge, matching: str, say: str = "") -> str:
    """As `nc` shows it."""
    with bridge.connect() as connection, connection.makefile() as lines:
        connection.settimeout(PATIENCE_S)
        connection.sendall(say.encode())
        for line in lines:
            if re.fullmatch(matching, line.strip()):
                return line
    raise AssertionError(f"no {matching}")


def metrics(bridge: RunningBridge) -> bytes:
    page = urllib.request.urlopen(f"http://{bridge.where}/metrics", timeout=PATIENCE_S)
    return bytes(page.read())


@pytest.mark.slow
@pytest.mark.parametrize("line", SERVING)
def test_who_serves_is_of_use(place: Place, line: str) -> None:
    number = r"-?\d+\.\d+"
    with serving(line, place) as bridge:
        if "--template" in line:
            a_line(bridge, rf"(-?\d+\.\d\d\d;){{3}}({number}|nan)")
        elif "--points" in line:
            a_line(bridge, rf"\d{{19}},({number},){{6}}.*")
        elif "stream" in line:
            a_line(bridge, rf"({number} ){{5}}{number}")
        elif "ippdme" in line:
            a_line(bridge, "00001 %", "00001 StartSession()\r\n")
            asked = "00001 StartSession()\r\n00002 EnumTools()\r\n"
            a_line(bridge, '00002 # "PROBE1.TIP1A0B0"' if "alias" in line else "00002 %", asked)
        elif "view" in line:
            page = urllib.request.urlopen(f"http://{bridge.where}/", timeout=PATIENCE_S)
            assert b"<title>armd</title>" in page.read()
        elif "--metrics" in line:
            # It serves before it has heard of any arm.
            wait_until(lambda: b'serial="SIM-0001"' in metrics(bridge))
        else:  # what then comes there: test_ros2_live.py
            assert bridge.where == place.router


@pytest.mark.slow
def test_what_ends_leaves_its_file(place: Place) -> None:
    with armd.connect(endpoint=place.daemon.endpoint) as arm:
        past = [json.dumps(measurement) for measurement in arm.past("measurement")]
    (place.folder / "measured.jsonl").write_text("\n".join(past) + "\n")
    calibration_of(place.folder)
    for line, left in DONE.items():
        run = run_armd(*here(line, place))
        assert (run.returncode, run.stderr) == (0, ""), line
        assert (place.folder / left).stat().st_size > 100, line
    assert np.loadtxt(place.folder / "points.xyz").shape[1] == 6


@pytest.mark.slow
@pytest.mark.parametrize("line", FOR_EVER)
def test_who_shows_the_fleet(place: Place, line: str) -> None:
    run = run_armd(*here(line, place), "--seconds", "3")
    assert (run.returncode, run.stderr) == (0, "")
    assert "SIM-0001" in run.stdout
    if "--json" in line:
        assert json.loads(run.stdout.splitlines()[-1])["serial"] == "SIM-0001"


@pytest.mark.slow
def test_the_subscriber_of_the_page(place: Place) -> None:
    """As written, but for the port."""
    text = page_path("subscriber").read_text(encoding="utf-8")
    (program,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)[:1]
    program = program.replace("connect()", f"connect(endpoint={place.daemon.endpoint!r})")
    with subprocess.Popen([sys.executable, "-uc", program], stdout=subprocess.PIPE) as running:
        assert running.stdout is not None
        said = running.stdout.readline()
        running.kill()
    assert re.match(rb"\d+ \(-?\d+\.\d+, ", said)


def calibration_of(folder: Path) -> None:
    arm = load_arm(folder / "arm.toml")
    values = arm.nominal()
    values[arm.layout.index("a_2")] += 0.5
    save_calibration(folder / "calibration-2.json", drawn(arm, values=values))


def test_the_addresses_of_the_pages_are_nobodys() -> None:
    """192.0.2.0/24 and .example are set aside for documents."""
    text = "".join(page_path(name).read_text(encoding="utf-8") for name in PAGES)
    for host in re.findall(r"(?:tcp/|--listen )([\w.-]+):\d+", text):
        assert re.fullmatch(r"(127|0|192\.0\.2)\.[\d.]+|[\w.-]+\.example|HOST|ADDRESS", host), host
