"""`pip install ./deploy/client`: the subscriber's part in an environment of its own."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.timeout(600)
#: Imports what the examples use, and tells what came with it and how long armd itself took.
PROBE = """
import json, sys, time
import numpy, zenoh
from zenoh import ext
began_s = time.perf_counter()
import armd
armd.connect, armd.POINT, armd.Flag, armd.Lost, armd.joints_dtype
print(json.dumps({"seconds": time.perf_counter() - began_s, "modules": sorted(sys.modules)}))
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of an environment that has nothing but the client and what it asks for."""
    folder = tmp_path_factory.mktemp("slim")
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    own = folder / "bin" / "python"
    install = [own, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    if subprocess.run([*install, "numpy", "eclipse-zenoh>=1.10,<2"]).returncode != 0:
        pytest.skip("no package index to install from")
    subprocess.run([*install, ROOT / "deploy" / "client"], check=True)
    return own


@pytest.mark.slow
def test_it_needs_numpy_and_zenoh_alone(python: Path) -> None:
    command = [python, "-m", "pip", "list", "--format", "json", "--disable-pip-version-check"]
    told = subprocess.run(command, check=True, capture_output=True, text=True)
    names = {package["name"] for package in json.loads(told.stdout)}
    assert names - {"pip", "setuptools"} == {"armd-client", "numpy", "eclipse-zenoh"}


@pytest.mark.slow
def test_importing_it_costs_little_beside_its_dependencies(python: Path, tmp_path: Path) -> None:
    def probe() -> dict[str, object]:
        command = [python, "-c", PROBE]
        told = subprocess.run(command, check=True, capture_output=True, text=True, cwd=tmp_path)
        found: dict[str, object] = json.loads(told.stdout)
        return found

    tries = [probe() for _ in range(5)]
    heavy = {"numba", "scipy", "pyarrow", "matplotlib", "pydantic", "rich"}
    assert not heavy & set(tries[0]["modules"])  # type: ignore[call-overload]
    seconds = min(float(found["seconds"]) for found in tries)  # type: ignore[arg-type]
    print(f"import armd after its dependencies: {1000 * seconds:.1f} ms")


@pytest.mark.slow
def test_it_hears_a_daemon(python: Path, tmp_path: Path) -> None:
    """The README's subscriber, unchanged."""
    from support.running_daemon import running_daemon
    from support.simulated_arm import simulated_arm

    example = ROOT / "docs" / "examples" / "subscriber.py"
    with (
        simulated_arm(tmp_path, seconds=60) as arm,
        running_daemon(tmp_path, arm.port) as daemon,
    ):
        command = [python, example, daemon.endpoint]
        told = subprocess.run(command, check=True, capture_output=True, text=True, timeout=60)
    assert len(told.stdout.splitlines()) > 1000


def test_both_distributions_are_of_one_version() -> None:
    slim, whole = (
        tomllib.loads((ROOT / name).read_text())["project"]
        for name in ("deploy/client/pyproject.toml", "pyproject.toml")
    )
    assert slim["version"] == whole["version"]
    assert set(slim["dependencies"]) <= set(whole["dependencies"])
