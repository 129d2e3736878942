"""A 64-bit ARM board: there are wheels for it, and drivers and kernel pass their tests there.

The board is qemu-user, that processor in software: what is right shows, how fast it is does not.
"""

from __future__ import annotations

import platform
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from deploy.arm64_python import Arm64Python, Unavailable

PROJECT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.timeout(3000)
PLATFORMS = ["manylinux_2_28_aarch64", "manylinux_2_17_aarch64", "manylinux2014_aarch64"]
PYTHONS = ["3.11", "3.12", "3.13", "3.14"]
#: Of drivers: bytes, counters, turns; of the kernel: sines, basis functions, the chain of joints.
TESTS = [
    "tests/drivers/serial/test_serial_wire.py",
    "tests/drivers/serial/test_sequence.py",
    "tests/drivers/test_unwrap.py",
    "tests/model/test_kernel_arithmetic.py",
    "tests/model/test_basis.py",
]


def pip(
    *arguments: str | Path, python: str, verb: str = "install"
) -> subprocess.CompletedProcess[str]:
    """`pip install` of wheels for this Python on 64-bit ARM, or `pip download`."""
    command = [sys.executable, "-m", "pip", verb, "--quiet", "--disable-pip-version-check"]
    command += ["--only-binary", ":all:", "--python-version", python]
    command += ["--ignore-installed"] * (verb == "install")
    command += [word for name in PLATFORMS for word in ("--platform", name)]
    pins = ["--constraint", str(PROJECT / "requirements.txt")]
    return subprocess.run([*command, *pins, *arguments], capture_output=True, text=True)


def test_what_is_run_there_is_there() -> None:
    """And needs only what is installed there: a renamed file would fail long after its change."""
    for name in TESTS:
        (_, *words) = (PROJECT / name).read_text().split("from support")
        assert "def test_" in (PROJECT / name).read_text() and "zenoh" not in "".join(words)


@pytest.fixture(scope="module")
def index(tmp_path_factory: pytest.TempPathFactory) -> None:
    target = tmp_path_factory.mktemp("index")
    found = pip("--dry-run", "--no-deps", "--target", target, "pyserial", python="3.11")
    if found.returncode != 0:
        pytest.skip(f"no package index: {found.stderr.strip()[-200:]}")


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("python", PYTHONS)
@pytest.mark.usefixtures("index")
def test_there_is_a_wheel_of_everything(python: str, tmp_path: Path) -> None:
    """Of all that armd installs, but cobs, which builds without a compiler."""
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]
    wanted = project["dependencies"]
    names = [line for line in wanted if not line.startswith("cobs")]
    assert len(names) == len(wanted) - 1
    found = pip("--dry-run", "--target", tmp_path / "none", *names, python=python)
    assert found.returncode == 0, found.stderr


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.usefixtures("index")
def test_it_would_be_noticed(tmp_path: Path) -> None:
    """The test above can fail: of this there is no wheel."""
    found = pip("--dry-run", "--no-deps", "--target", tmp_path / "none", "cobs", python="3.14")
    assert found.returncode != 0 and "cobs" in found.stderr


@pytest.fixture(scope="module")
def arm64(index: None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Arm64Python]:
    if platform.machine() == "aarch64":
        pytest.skip("this is one: its own tests show more")
    folder = tmp_path_factory.mktemp("arm64")
    try:
        python = Arm64Python(folder)
        names = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]["dependencies"]
        names = [name for name in names if not name.startswith("cobs")]
        names += ["numba", "scipy", "pytest", "pytest-timeout", "hypothesis"]
        found = pip("--dest", folder / "wheels", *names, python="3.11", verb="download")
        assert found.returncode == 0, found.stderr
        python.add(sorted(map(str, (folder / "wheels").iterdir())))
        yield python
    except Unavailable as reason:
        pytest.skip(str(reason))
    finally:
        shutil.rmtree(folder)


@pytest.mark.slow
@pytest.mark.long
def test_drivers_and_kernel_pass_their_tests_there(arm64: Arm64Python) -> None:
    told = arm64.run("-c", "import platform; print(platform.machine())")
    assert told.stdout == "aarch64\n", told.stderr
    ran = arm64.run(
        "-m", "pytest", "-q", "-p", "no:cacheprovider", "--hypothesis-profile", "ci", *TESTS
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    passed = re.search(r"^(\d+) passed", ran.stdout, re.MULTILINE)
    assert passed is not None and int(passed[1]) > 60, ran.stdout
