"""What a controller gets: armd with its compiled functions, without compiler and mathematics."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from armd.compiled.ahead import can_link
from armd.daemon.cli import OFFLINE
from support.running_daemon import Daemon, free_endpoint, write_config
from support.simulated_arm import simulated_arm

ROOT = Path(__file__).parents[2]
MOST_INSTALLED_MB = 300
MOST_RESIDENT_MB = 120
pytestmark = pytest.mark.timeout(1800)


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Installed from a wheelhouse as install.sh does it, by a program that sees no network."""
    if not can_link():
        pytest.skip("no C++ compiler")
    folder = tmp_path_factory.mktemp("base")
    wheels = folder / "wheelhouse"
    made = subprocess.run(
        ["sh", ROOT / "deploy/wheelhouse.sh", wheels], env=os.environ | {"PYTHON": sys.executable}
    )
    if made.returncode != 0:
        pytest.skip("no package index to fill a wheelhouse from")
    place = folder / "environment"
    subprocess.run([sys.executable, "-m", "venv", place], check=True)
    pip = [place / "bin/python", "-m", "pip", "--quiet", "--disable-pip-version-check"]
    offline = [*pip, "install", "--no-index", "--no-deps", "--find-links", wheels]
    subprocess.run([*offline, "-r", ROOT / "deploy/controller.txt", "armd"], check=True, cwd=folder)
    return place


def test_the_list_of_a_controller_has_nothing_of_the_mathematics() -> None:
    lines = (ROOT / "deploy/controller.txt").read_text().splitlines()
    names = {re.split(r"[ ;=<>]", line)[0].lower() for line in lines if line and line[0] != "#"}
    assert {"numpy", "eclipse-zenoh", "pyserial"} <= names
    assert not names & OFFLINE


@pytest.mark.slow
@pytest.mark.long
def test_it_is_small_and_has_nothing_of_the_mathematics(environment: Path) -> None:
    kib = subprocess.run(["du", "-sk", environment], capture_output=True, text=True, check=True)
    assert int(kib.stdout.split()[0]) <= MOST_INSTALLED_MB * 1000
    program = (
        "import json, sys; from importlib.util import find_spec;"
        "print(json.dumps([name for name in sys.argv[1:] if find_spec(name) is not None]))"
    )
    found = subprocess.run(
        [environment / "bin/python", "-I", "-c", program, *OFFLINE], capture_output=True, check=True
    )
    assert json.loads(found.stdout) == []


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("joints", [3, 9])
def test_an_arm_with_that_many_joints_finds_all_compiled(
    environment: Path, tmp_path: Path, joints: int
) -> None:
    """Without numba nothing else could compile it."""
    ran = subprocess.run(
        [environment / "bin/python", "-I", "-m", "armd.compiled.ahead", "--joints", str(joints)],
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}, capture_output=True, text=True,
    )  # fmt: skip
    assert (ran.returncode, ran.stderr) == (0, "")
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.long
def test_it_serves_points_from_an_empty_cache_in_little_memory(
    environment: Path, tmp_path: Path
) -> None:
    endpoint = free_endpoint()
    with simulated_arm(tmp_path, link=True) as arm:
        config = write_config(tmp_path, arm.port, endpoint)
        command = [environment / "bin/armd", "run", "--allow-root", config]
        log = tmp_path / "daemon.log"
        with (
            log.open("w") as errors,
            subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=errors, text=True, cwd=tmp_path,
                env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")},
            ) as process,
        ):  # fmt: skip
            try:
                assert process.stdout is not None
                assert process.stdout.readline().startswith("armd: ready SIM-0001"), log.read_text()
                with Daemon(process, endpoint, "SIM-0001", log).listen() as heard:
                    heard.wait_for(lambda: len(heard.points()) > 2000)
                    points = heard.points()
                    time.sleep(2)
                    rollup = Path(f"/proc/{process.pid}/smaps_rollup").read_text()
            finally:
                process.terminate()
    assert abs(points["position_mm"][-1]).max() > 1.0
    (resident_kib,) = (int(line.split()[1]) for line in rollup.splitlines() if "Rss:" in line)
    print(rollup)
    assert resident_kib <= MOST_RESIDENT_MB * 1000


@pytest.mark.slow
@pytest.mark.long
def test_every_command_of_a_controller_starts(environment: Path) -> None:
    ran = subprocess.run(
        [environment / "bin/python", "-I", "-m", "armd.daemon.start_check"],
        capture_output=True, text=True,
    )  # fmt: skip
    assert (ran.returncode, ran.stderr) == (0, "")


@pytest.mark.slow
@pytest.mark.long
def test_a_command_that_needs_more_says_what_to_install(environment: Path) -> None:
    ran = subprocess.run(
        [environment / "bin/armd", "diagnose", "nothing"], capture_output=True, text=True
    )
    assert ran.returncode == 2
    python = ran.stderr.split("this needs it: ")[1].split(" -m ")[0]
    for name in ("'numba<0.69,>=0.61'", "'scipy>=1.15'", "'pyarrow>=18'", "'matplotlib>=3.9'"):
        assert name in ran.stderr
    assert "armd'" not in ran.stderr  # of which no index has one
    assert Path(python).parent == environment / "bin"
