"""What is compiled ahead is what `armd run` needs: a start after it compiles nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numba import typeof

from armd.compensation.kernel import kernel
from armd.compensation.kernel.model import Model
from armd.compiled import ahead as program
from armd.compiled import library
from armd.compiled.ahead import call_for_sessions, can_link, remove_others
from armd.daemon.config import load_config
from support import synthetic
from support.own_environment import own_environment
from support.small_arm import small_arm, thermal_calibration

TESTS = Path(__file__).parents[1]
#: Where an environment has its library.
OF_ENVIRONMENT = Path("share/armd") / library.name_file()
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


#: A verification's points of a made-up session; prints whether numba was needed for them.
VERIFICATION = """
import sys
import numpy as np
from support import synthetic
from armd.compensation.verify.figures import correct_positions

arm, rng = synthetic.arm(), np.random.default_rng(8)
session = synthetic.session(arm, arm.nominal(), rng, readings=48)
assert np.isfinite(correct_positions(session, arm, None)).all()
print("numba" in sys.modules)
"""


@pytest.fixture
def python(tmp_path: Path) -> Path:
    """Of an environment without a library, which ours has."""
    return own_environment(tmp_path / "environment")


def ahead(python: Path, cache: Path, *files: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [python, "-I", "-m", "armd.compiled.ahead", *files],
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


def files_in(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file()]


#: A pipeline's points of made-up samples; prints whether numba was needed for them.
PROGRAM = """
import sys
from pathlib import Path
import numpy as np
from armd.daemon.config import load_config
from armd.daemon.live.pipeline import Pipeline
from armd.drivers.sample import Temperatures, sample_dtype

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


def points_of(
    python: Path, cache: Path, config: Path, **environment: str
) -> tuple[bool, np.ndarray]:
    place = config.with_name("points.npy")
    ran = subprocess.run(
        [python, "-c", PROGRAM, config, place],
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache), **environment},
        capture_output=True, text=True,
    )  # fmt: skip
    assert ran.stdout in ("True\n", "False\n"), ran.stderr
    return ran.stdout == "True\n", np.load(place)


@pytest.mark.slow
@pytest.mark.timeout(900)  # it compiles twice
def test_the_library_gives_numbas_points_without_numba(tmp_path: Path, python: Path) -> None:
    """With the rounding of fused operations between them: the library is for any processor. A
    diagnosis needs no numba beside it either. None of it asks what became of the cache."""
    if not can_link():
        pytest.skip("no C++ compiler")
    cache, empty = tmp_path / "cache", tmp_path / "empty"
    config = configured(tmp_path, 3)
    done = ahead(python, cache, config)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert files_in(python.parents[1] / "share") == [python.parents[1] / OF_ENVIRONMENT]
    assert files_in(cache) == []
    needed, points = points_of(python, empty, config)
    assert not needed and not empty.exists()
    needed, expected = points_of(python, cache, config, ARMD_WITHOUT_LIBRARY="1")
    assert needed and files_in(cache)
    for name in ("position_mm", "orientation"):
        np.testing.assert_allclose(points[name], expected[name], rtol=0, atol=1e-11)
    for name in ("seq", "flags", "monotonic_ns", "stamp_ns", "buttons", "calibration"):
        np.testing.assert_array_equal(points[name], expected[name])
    assert np.ptp(points["position_mm"], axis=0).min() > 1.0
    for program_text in (DIAGNOSIS, VERIFICATION):
        ran = subprocess.run(
            [python, "-c", program_text],
            env=os.environ | {"NUMBA_CACHE_DIR": str(empty), "PYTHONPATH": str(TESTS)},
            capture_output=True, text=True,
        )  # fmt: skip
        assert ran.stdout == "False\n", ran.stderr


def test_what_is_compiled_ahead_is_called_with_the_same_types_by_verify(monkeypatch) -> None:
    """Another layout of one array would be compiled anew, each time."""
    called = []

    def noted(*arguments: object) -> None:
        called.append([typeof(argument) for argument in arguments])

    monkeypatch.setattr(kernel, "correct_runs", noted)
    call_for_sessions(small_arm())
    arm = synthetic.arm()
    session = synthetic.session(arm, arm.nominal(), np.random.default_rng(8), readings=48)
    Model(arm, None).correct_states(session.states)
    small = small_arm()
    states = replace(
        session.states,
        q=session.states.q[:, : small.n_joints],
        rate=session.states.rate[:, : small.n_joints],
        temperature_c=np.full((session.n, len(small.sensors)), 21.0),
    )
    Model(small, thermal_calibration(small)).correct_states(states)
    assert len(called) == 3 and called[0] == called[1] == called[2]


@pytest.mark.slow
def test_a_library_of_the_cache_alone_is_copied(tmp_path: Path, python: Path) -> None:
    """One that another installation made there; nothing is compiled, then or without a cache."""
    modules = library.load_libraries()
    ours = [Path(module.__file__) for module in modules if module.__file__ is not None]
    if [path.name for path in ours] != [library.name_file()]:
        pytest.skip("no library of compiled functions: there was no C++ compiler to make it")
    cache, made = tmp_path / "cache", ours[0].read_bytes()
    cache.mkdir()
    (cache / library.name_file()).write_bytes(made)
    kept = python.parents[1] / OF_ENVIRONMENT
    config = configured(tmp_path, 3)
    done = ahead(python, cache, config)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert kept.read_bytes() == made and files_in(kept.parent) == [kept]
    assert files_in(cache) == [cache / library.name_file()]
    needed, points = points_of(python, tmp_path / "empty", config)
    assert not needed and not (tmp_path / "empty").exists()
    assert np.ptp(points["position_mm"], axis=0).min() > 1.0


def test_where_the_environment_takes_no_file_the_cache_has_the_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file stands where the folder would: nobody can write there, root neither."""
    asked: list[list[str]] = []

    def noted(command: list[str]) -> subprocess.CompletedProcess[str]:
        asked.append(command)
        return subprocess.CompletedProcess(command, 0)

    environment, cache = tmp_path / "environment", tmp_path / "cache"
    environment.mkdir()
    monkeypatch.setattr(sys, "prefix", str(environment))
    monkeypatch.setattr(sys, "argv", ["ahead"])
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache))
    monkeypatch.setattr(library, "load_libraries", lambda: ())
    monkeypatch.setattr(program, "can_link", lambda: True)
    monkeypatch.setattr(subprocess, "run", noted)
    assert program.main() == 0
    (environment / "share/armd").rmdir()
    (environment / "share/armd").touch()
    assert program.main() == 0
    into = [command[command.index("--into") + 1] for command in asked]
    assert into == [str(environment / "share/armd"), str(cache)]


def test_without_a_file_it_is_for_every_number_of_joints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever plugs in an arm of five joints shall not wait for a compiler."""
    asked: list[list[int]] = []
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(program, "can_link", lambda: False)
    monkeypatch.setattr(program, "call", lambda files, numbers, part: asked.append([*numbers]))
    for arguments in ([], ["some.toml"], ["--joints", "7"], ["--demo", "live"]):
        monkeypatch.setattr(sys, "argv", ["ahead", *arguments])
        assert program.main() == 0
    assert asked == [[3, 4, 5, 6, 7, 8, 9], [], [7], [6]]


def test_every_made_up_arm_is_one_that_a_daemon_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    """`make install` calls them all: one that a check refuses would stop it."""
    called = []

    def take(path: Path, part: str = "") -> None:
        assert part == ""
        called.append(load_config(path))

    monkeypatch.setattr(program, "call_everything", take)
    program.call([], range(3, 10))
    assert {config.arm.n_joints for config in called} == {*range(3, 10)}
    assert {config.driver.kind for config in called} == {"serial", "microscribe"}


@pytest.mark.slow
def test_a_bad_file_is_told_of_and_stops_nothing(tmp_path: Path, python: Path) -> None:
    bad = configured(tmp_path, 0)
    done = ahead(python, tmp_path / "cache", bad)
    assert done.returncode == 0
    assert done.stderr.startswith(f"armd: not compiled ahead: {tmp_path / 'arm.toml'}: joint: ")


def test_other_versions_leave_cache_and_environment_and_nothing_else_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache, environment = tmp_path / "cache", tmp_path / "environment/share/armd"
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "environment"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache))
    own = {library.hash_sources(), library.name_file(), "notes.txt", "0123456789abcdef"}
    own.add(library.name_file("live"))
    others = {"0123456789ab", "kernel_0123456789ab.cpython-311-x86_64-linux-gnu.so"}
    others.add(f"kernel_{library.hash_sources()}.cpython-39-x86_64-linux-gnu.so")
    others.add("kernel_0123456789ab_sessions.cpython-311-x86_64-linux-gnu.so")
    for folder in cache, environment:
        folder.mkdir(parents=True)
        for name in own | others:
            if "." in name:
                (folder / name).write_text("machine code")
            else:
                (folder / name / "kernel").mkdir(parents=True)
    remove_others()
    assert {path.name for path in cache.iterdir()} == own
    assert {path.name for path in environment.iterdir()} == own
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "none"))
    remove_others()
