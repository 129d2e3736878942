"""What is built is whole: the wheel in an empty environment runs tests, and the sdist builds it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.timeout(900)
#: Fast, without an arm, a network or the pages in docs/; they reach every room. Folders are whole.
TESTS = (
    "diagnose",
    "estimate",
    "model",
    "package/test_public_face.py",
    "package/test_suggest.py",
    "compensation/test_session.py",
    "compensation/test_verify.py",
    "effects/test_every_cause.py",
    "daemon/commands/test_check.py",
    "daemon/test_daemon_config.py",
    "daemon/commands/test_arm_command.py",
    "drivers/serial/test_serial_decoder.py",
    "drivers/can/test_can_decoder.py",
    "bridges/test_ippdme_errors.py",
    "simulator/test_fault_schedule.py",
)


def test_tests_of_the_wheel_reach_every_room() -> None:
    """And are there: a renamed file would fail long after its change."""
    files = [file for name in TESTS for file in _files_of(ROOT / "tests" / name)]
    text = "".join(file.read_text() for file in files)
    rooms = ("compensation", "daemon", "drivers", "simulator")
    assert all(f"from armd.{room}." in text for room in rooms)


def _files_of(place: Path) -> list[Path]:
    assert place.exists(), place
    return sorted(place.rglob("*.py")) if place.is_dir() else [place]


def build(source: Path, into: Path) -> Path:
    """The wheel of *source*, which may be a folder or an sdist; without a library, which takes a
    minute to compile."""
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", into, source]
    subprocess.run(command, check=True, env=os.environ | {"ARMD_WITHOUT_LIBRARY": "1"})
    (wheel,) = into.glob("armd-*.whl")
    return wheel


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What git has, and nothing that building or testing left behind."""
    folder = tmp_path_factory.mktemp("tree")
    names = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, check=True,
    ).stdout  # fmt: skip
    archive = folder.parent / "tree.tar"
    listing = [
        name
        for name in names.decode().split("\0")
        if name and ((ROOT / name).is_file() or (ROOT / name).is_symlink())
    ]
    with tarfile.open(archive, "w") as tar:
        for name in listing:
            tar.add(ROOT / name, name)
    with tarfile.open(archive) as tar:
        tar.extractall(folder, filter="data")
    return folder


@pytest.fixture(scope="module")
def wheel(tree: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tree, tmp_path_factory.mktemp("wheel"))


def packaged(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as files:
        return {name for name in files.namelist() if ".dist-info/" not in name}


@pytest.mark.slow
def test_the_wheel_has_every_file_of_every_room(wheel: Path, tree: Path) -> None:
    """But for recipes, which say how a file that is there was made."""
    rooms = {"armd": "armd"} | {
        room: f"armd/{room}" for room in ("drivers", "compensation", "daemon", "simulator")
    }
    expected = {
        f"{package}/{path.relative_to(tree / room)}"
        for room, package in rooms.items()
        for path in (tree / room).rglob("*")
        if path.is_file() and not {"__pycache__", "recipe"} & set(path.parts)
    }
    assert packaged(wheel) == expected


@pytest.mark.slow
def test_the_sdist_builds_the_same_wheel(wheel: Path, tree: Path, tmp_path: Path) -> None:
    program = "import setuptools.build_meta as b, sys; print(b.build_sdist(sys.argv[1]))"
    environment = tmp_path / "build"
    subprocess.run([sys.executable, "-m", "venv", environment], check=True)
    python = environment / "bin" / "python"
    install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    if subprocess.run([*install, "setuptools>=77"]).returncode != 0:
        pytest.skip("no package index to install from")
    subprocess.run([python, "-c", program, tmp_path], cwd=tree, check=True, capture_output=True)
    (sdist,) = tmp_path.glob("armd-*.tar.gz")
    again = tmp_path / "again"
    again.mkdir()
    assert packaged(build(sdist, again)) == packaged(wheel)


@pytest.mark.slow
@pytest.mark.long
def test_tests_pass_in_an_empty_environment(wheel: Path, tmp_path: Path) -> None:
    """With what the wheel asks for, and nothing of this checkout in sight."""
    environment = tmp_path / "empty"
    subprocess.run([sys.executable, "-m", "venv", environment], check=True)
    python = environment / "bin" / "python"
    install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    wanted = [wheel, "pytest", "pytest-timeout", "hypothesis"]
    if subprocess.run([*install, *wanted]).returncode != 0:
        pytest.skip("no package index to install from")
    for name in TESTS:
        whole = not name.endswith(".py")
        folder = ROOT / "tests" / name if whole else (ROOT / "tests" / name).parent
        for path in folder.glob("*.py"):
            if whole or not path.name.startswith("test_") or name.endswith(path.name):
                place = tmp_path / path.relative_to(ROOT)
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_bytes(path.read_bytes())
    shutil.copy(ROOT / "tests" / "conftest.py", tmp_path / "tests")
    shutil.copytree(ROOT / "tests" / "support", tmp_path / "tests" / "support")
    settings = "[pytest]\npythonpath = tests\nmarkers =\n  slow: slow\n  long: long\n"
    (tmp_path / "pytest.ini").write_text(settings)
    ran = subprocess.run(
        [python, "-P", "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not slow", "tests"],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stdout[-4000:] + ran.stderr[-1000:]
    print(ran.stdout.splitlines()[-1])
    where = subprocess.run(
        [python, "-c", "import armd; print(armd.__file__)"],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert where.stdout.startswith(str(environment))
