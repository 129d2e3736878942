"""What is compiled ahead is what `armd run` needs: a start after it compiles nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from armd.compiled import library
from armd.daemon import ahead as program
from armd.daemon.ahead import can_link, tidy
from armd.daemon.config import load_config

TESTS = Path(__file__).parents[1]
ARM = """\
schema = "armd.arm/1"
serial_number = "AHEAD"
[[temperature_sensor]]
name = "room"
[tip]
offset_mm = [45.0, 0.0, 110.0]
"""
JOINT = """\
[[joint]]
d_mm = 120.0
a_mm = 300.0
alpha_deg = 90.0
counts_per_turn = 262144
temperature = "room"
"""


def ahead(cache: Path, *files: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-I", "-m", "armd.daemon.ahead", *files],
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )


def configured(folder: Path, joints: int) -> Path:
    (folder / "arm.toml").write_text(ARM + joints * JOINT)
    path = folder / "armd.toml"
    path.write_text(
        'schema = "armd.daemon/1"\narm = "arm.toml"\n'
        '[driver]\nkind = "serial"\nport = "/dev/nowhere"\n'
    )
    return path


#: A pipeline's points of made-up samples; prints whether numba was needed for them.
PROGRAM = """
import sys
from pathlib import Path
import numpy as np
from armd.compiled import library
from armd.daemon.config import load_config
from armd.daemon.live.pipeline import Pipeline
from armd.drivers.sample import Temperatures, sample_dtype

if sys.argv[3:] == ["without"]:
    library.do_without()
config = load_config(Path(sys.argv[1]))
pipeline = Pipeline(config.arm, None, config.file.limits)
pipeline.take_temperatures(Temperatures(np.array([23.0]), 0, 0, 0))
samples = np.zeros(500, sample_dtype(3))
samples["seq"] = np.arange(500)
samples["monotonic_ns"] = samples["stamp_ns"] = np.arange(500) * 1_000_000 + 1
samples["count"] = np.random.default_rng(4).normal(scale=300.0, size=(500, 3)).cumsum(axis=0)
points = [pipeline.correct(samples[k : k + 1])[0] for k in range(100)]
np.save(sys.argv[2], np.concatenate([*points, pipeline.correct(samples[100:])[0]]))
print("numba" in sys.modules)
"""

#: A diagnosis of made-up sessions; prints whether numba was needed for it.
DIAGNOSIS = """
import sys
import numpy as np
from support import synthetic
from armd.compensation.diagnose.diagnose import diagnose

arm, rng = synthetic.arm(), np.random.default_rng(8)
some = [synthetic.session(arm, arm.nominal(), rng, readings=48, noise_mm=0.01) for _ in range(2)]
diagnose(some, arm)
print("numba" in sys.modules)
"""


def points_of(cache: Path, config: Path, *without: str) -> tuple[bool, np.ndarray]:
    place = cache / "points.npy"
    ran = subprocess.run(
        [sys.executable, "-c", PROGRAM, config, place, *without],
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache)}, capture_output=True, text=True,
    )  # fmt: skip
    assert ran.stdout in ("True\n", "False\n"), ran.stderr
    return ran.stdout == "True\n", np.load(place)


@pytest.mark.slow
@pytest.mark.timeout(900)  # it compiles twice
def test_the_library_gives_numbas_points_without_numba(tmp_path: Path) -> None:
    """With the rounding of fused operations between them: the library is for any processor. A
    diagnosis needs no numba beside it either."""
    if not can_link():
        pytest.skip("no C++ compiler")
    cache = tmp_path / "cache"
    config = configured(tmp_path, 3)
    done = ahead(cache, config)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert [path.name for path in cache.rglob("*") if path.is_file()] == [library.file_name()]
    needed, points = points_of(cache, config)
    assert not needed
    needed, expected = points_of(cache, config, "without")
    assert needed
    for name in ("position_mm", "orientation"):
        np.testing.assert_allclose(points[name], expected[name], rtol=0, atol=1e-11)
    for name in ("seq", "flags", "monotonic_ns", "stamp_ns", "buttons", "calibration"):
        np.testing.assert_array_equal(points[name], expected[name])
    assert np.ptp(points["position_mm"], axis=0).min() > 1.0
    diagnosed = subprocess.run(
        [sys.executable, "-c", DIAGNOSIS],
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(TESTS)},
        capture_output=True, text=True,
    )  # fmt: skip
    assert diagnosed.stdout == "False\n", diagnosed.stderr


def test_without_a_file_it_is_for_every_number_of_joints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever plugs in an arm of five joints shall not wait for a compiler."""
    asked: list[list[int]] = []
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(program, "can_link", lambda: False)
    monkeypatch.setattr(program, "call", lambda files, numbers: asked.append(list(numbers)))
    for arguments in ([], ["some.toml"], ["--joints", "7"]):
        monkeypatch.setattr(sys, "argv", ["ahead", *arguments])
        assert program.main() == 0
    assert asked == [[3, 4, 5, 6, 7, 8, 9], [], [7]]


def test_every_made_up_arm_is_one_that_a_daemon_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    """`make install` calls them all: one that a check refuses would stop it."""
    called = []
    monkeypatch.setattr(program, "call_everything", lambda path: called.append(load_config(path)))
    program.call([], range(3, 10))
    assert {config.arm.n_joints for config in called} == {*range(3, 10)}
    assert {config.driver.kind for config in called} == {"serial", "microscribe"}


def test_a_bad_file_is_told_of_and_stops_nothing(tmp_path: Path) -> None:
    bad = configured(tmp_path, 0)
    done = ahead(tmp_path / "cache", bad)
    assert done.returncode == 0
    assert done.stderr.startswith(f"armd: not compiled ahead: {tmp_path / 'arm.toml'}: joint: ")


def test_other_versions_leave_the_cache_and_nothing_else_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    own = {library.sources(), library.file_name(), "notes.txt", "0123456789abcdef"}
    others = {"0123456789ab", "kernel_0123456789ab.cpython-311-x86_64-linux-gnu.so"}
    others.add(f"kernel_{library.sources()}.cpython-39-x86_64-linux-gnu.so")
    for name in own | others:
        if "." in name:
            (tmp_path / name).write_text("machine code")
        else:
            (tmp_path / name / "kernel").mkdir(parents=True)
    tidy()
    assert {path.name for path in tmp_path.iterdir()} == own
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "none"))
    tidy()
