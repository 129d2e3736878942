"""A 64-bit ARM board: there are wheels for it (docs/performance.md says what qemu-user showed)."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[2]
PLATFORMS = ["manylinux_2_28_aarch64", "manylinux_2_17_aarch64", "manylinux2014_aarch64"]
PYTHONS = ["3.11", "3.12", "3.13", "3.14"]
pytestmark = [pytest.mark.slow, pytest.mark.timeout(3000)]


def pip(*arguments: str | Path, python: str) -> subprocess.CompletedProcess[str]:
    """`pip install` of wheels for this Python on 64-bit ARM."""
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    command += ["--only-binary", ":all:", "--ignore-installed", "--python-version", python]
    command += [word for name in PLATFORMS for word in ("--platform", name)]
    pins = ["--constraint", str(PROJECT / "requirements.txt")]
    return subprocess.run([*command, *pins, *arguments], capture_output=True, text=True)


@pytest.fixture(scope="module")
def index(tmp_path_factory: pytest.TempPathFactory) -> None:
    target = tmp_path_factory.mktemp("index")
    found = pip("--dry-run", "--no-deps", "--target", target, "pyserial", python="3.11")
    if found.returncode != 0:
        pytest.skip(f"no package index: {found.stderr.strip()[-200:]}")


@pytest.mark.parametrize("python", PYTHONS)
@pytest.mark.usefixtures("index")
def test_there_is_a_wheel_of_everything(python: str, tmp_path: Path) -> None:
    """Of all that armd[offline] installs, but cobs, which builds without a compiler."""
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]
    wanted = project["dependencies"] + project["optional-dependencies"]["offline"]
    names = [line for line in wanted if not line.startswith("cobs")]
    assert len(names) == len(wanted) - 1
    found = pip("--dry-run", "--target", tmp_path / "none", *names, python=python)
    assert found.returncode == 0, found.stderr


@pytest.mark.usefixtures("index")
def test_it_would_be_noticed(tmp_path: Path) -> None:
    """The test above can fail: of this there is no wheel."""
    found = pip("--dry-run", "--no-deps", "--target", tmp_path / "none", "cobs", python="3.14")
    assert found.returncode != 0 and "cobs" in found.stderr
