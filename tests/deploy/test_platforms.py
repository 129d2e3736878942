"""Every dependency has a wheel for Windows and macOS, and for each Python that armd takes: the
package index is asked, nothing is installed."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.tags import mac_platforms

ROOT = Path(__file__).parents[2]
#: As pip names them: the oldest that the libraries still build for, newest last.
PLATFORMS = {
    "windows": ["win_amd64"],
    "macos-arm": [f"macosx_{n}_0_arm64" for n in range(11, 16)],
    "macos-intel": ["macosx_10_12_x86_64", "macosx_10_13_x86_64", "macosx_10_15_x86_64"]
    + [f"macosx_{n}_0_x86_64" for n in range(11, 16)],
}
#: Comes as source alone; it builds without a compiler, in pure Python.
SOURCE = "cobs"


def download(into: Path, platforms: list[str], names: list[str]) -> str:
    """What pip says of wheels of *names*, with all they require; "" if it has them."""
    options = ["--quiet", "--disable-pip-version-check", "--only-binary", ":all:"]
    options += ["--python-version", "3.12", "--implementation", "cp", "--dest", str(into)]
    options += [word for platform in platforms for word in ("--platform", platform)]
    done = subprocess.run(
        [sys.executable, "-m", "pip", "download", *options, *names], capture_output=True, text=True
    )
    return "" if done.returncode == 0 else done.stderr


@pytest.fixture(scope="module")
def names(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp("asked")
    ask = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", folder]
    if subprocess.run([*ask, "pyserial"], capture_output=True).returncode != 0:
        pytest.skip("no package index to ask")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return [name for name in project["dependencies"] if not name.startswith(SOURCE)]


def test_the_platforms_are_named_as_wheels_name_them() -> None:
    """pip takes any word for a platform, and finds no wheel for a misspelt one."""
    newest = (15, 0)
    known = {*mac_platforms(newest, "arm64"), *mac_platforms(newest, "x86_64"), "win_amd64"}
    assert {name for names in PLATFORMS.values() for name in names} <= known


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("system", PLATFORMS)
def test_every_dependency_has_a_wheel(system: str, names: list[str], tmp_path: Path) -> None:
    said = download(tmp_path, PLATFORMS[system], names)
    if not said:
        return
    alone = {
        name: download(tmp_path, PLATFORMS[system], ["--no-deps", name]).strip()[-300:]
        for name in names
    }
    missing = {name: text for name, text in alone.items() if text}
    assert not missing and not said, f"{system}: {missing or said[-1000:]}"
