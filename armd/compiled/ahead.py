"""Makes the library of compiled functions before a daemon starts: `python -m armd.compiled.ahead`.

It makes every compiled call of a daemon once, on made-up samples: for the arms of the given
armd.toml files, or for arms of 3 to 9 joints, or for that of `armd demo`. Then it makes the calls
of the commands that work on sessions. numba's ahead-of-time compiler exports the called functions,
and they are linked into the virtual environment or, where that cannot be written to, into the
cache. If there is a library already, or no C++ compiler, the calls are made all the same, and numba
compiles missing functions into its cache. A bad file is reported and skipped: `armd run` reports it
again.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np

from armd.compensation.kernel.model import Model
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import (
    Calibration,
    LoadedCalibration,
    Noise,
    name_constants,
)
from armd.compensation.model.kinematics import compute_frames, compute_jacobian, compute_pose
from armd.compensation.model.parameters import ParameterLayout
from armd.compensation.model.row_algebra import (
    compute_least_turns,
    compute_stretched_covariance,
    compute_whitening,
    rotate_towards,
)
from armd.compensation.model.state import Lag, States
from armd.compiled import library
from armd.compiled.rehearsal import run_rehearsal
from armd.daemon.config import Config, load_config
from armd.daemon.live.arm_in_use import ArmInUse
from armd.drivers.microscribe.wire import N_JOINTS
from armd.drivers.table import open_driver
from armd.errors import ArmdError

JOINT = "[[joint]]\nd_mm = 1.0\na_mm = 1.0\nalpha_deg = 90.0\ncounts_per_turn = 1048576\n"
ARM = 'schema = "armd.arm/1"\nserial_number = "ANY"\n[tip]\noffset_mm = [0, 0, 1]\n'
CONFIGURATION = 'schema = "armd.daemon/1"\narm = "arm.toml"\n[driver]\nkind = "{kind}"\n'
SERIAL, MICROSCRIBE = (
    CONFIGURATION.format(kind=kind) + 'port = "none"\n' for kind in ("serial", "microscribe")
)

#: The number of joints of `armd demo` without options.
DEMO_JOINTS = 6

#: Names that contain a hash of the sources: a folder for numba, a library.
OF_A_VERSION = re.compile(
    rf"[0-9a-f]{{12}}|kernel_[0-9a-f]{{12}}(_({'|'.join(library.PARTS)}))?\..*"
)


def call_everything(path: Path, part: str = "") -> None:
    """Make all compiled calls of `armd run` with this armd.toml, and of the offline commands.

    The latter work on sessions or on tables. With a *part* of `library.PARTS`, make only its calls,
    and none for tables. Raises `ArmdError` for a bad file.
    """
    config = load_config(path)
    if part != "sessions":
        call_for_live_points(config)
    if part != "live":
        call_for_sessions(config.arm)
    if not part:
        call_for_uncertainties(config.arm)


def call_for_live_points(config: Config) -> None:
    """Make the compiled calls of `armd run`."""
    run_rehearsal(config, ArmInUse(config))
    if config.driver.kind != "replay":  # replay opens its file; others open no port before `read`
        with closing(open_driver(config.driver, config.expectation)):
            pass


def call_for_sessions(arm: Arm) -> None:
    """Make the compiled calls of `armd calibrate`, `evaluate`, `diagnose`, `verify`.

    Importing numba and loading them from its cache takes longer than most of these commands.
    """
    q, constants = np.zeros((1, 1)), np.zeros(ParameterLayout(1).count)
    compute_frames(q, constants)
    compute_pose(q, constants)
    compute_jacobian(q, constants)
    rotate_towards(q, constants[None], np.zeros((1, 3)), 1, 0.1, 0.1)
    levers = np.ones((1, 3, 1))
    compute_stretched_covariance(levers, levers, compute_least_turns(levers, 0.1), 1.0, np.ones(1))
    compute_whitening(np.eye(3)[None], np.ones(1))
    Lag(1.0, 1).follow(np.zeros(1), np.zeros((1, 1)))
    Model(arm, None).correct_states(make_states(arm))


def call_for_uncertainties(arm: Arm) -> None:
    """Make the further calls of `armd correct` and `armd.Corrector`: 10 s of compilation."""
    model = Model(arm, make_calibration(arm))
    states = make_states(arm)
    model.uncertainty_rows(states, model.slow_values(states))


def make_states(arm: Arm) -> States:
    """Make one state of the arm, at rest at its reference temperature."""
    n = arm.n_joints
    return States(
        q=np.zeros((1, n)),
        rate=np.zeros((1, n)),
        temperature_c=np.full((1, len(arm.sensors)), arm.reference_temperature_c),
        time_s=np.zeros(1),
        approach=np.zeros((1, 3)),
        series=np.zeros(1, np.int64),
    )


def make_calibration(arm: Arm) -> LoadedCalibration:
    """Make a calibration with nominal constants and a repeatability of a micrometre."""
    content = Calibration(
        schema="armd.calibration/1",
        arm=arm.serial_number,
        created="2000-01-01T00:00:00Z",
        reference_temperature_c=arm.reference_temperature_c,
        constants=name_constants(arm.nominal(), arm.n_joints),
        noise=Noise(reading_mm=1e-3),
    )
    return LoadedCalibration(content, sha256="", path=Path("made-up.json"))


def make_arm_folder(folder: Path, joints: int, configuration: str = SERIAL) -> Path:
    """Write an arm.toml and the armd.toml of a made-up arm; return the latter's path."""
    (folder / "arm.toml").write_text(ARM + joints * JOINT, encoding="utf-8")
    path = folder / "armd.toml"
    path.write_text(configuration, encoding="utf-8")
    return path


def call(files: Iterable[Path], numbers: Sequence[int], part: str = "") -> None:
    """Make the calls of the daemons of these files, and of arms with these numbers of joints.

    A *part* of them is made on a serial wire only.
    """
    with tempfile.TemporaryDirectory() as folder:
        for joints in numbers:
            call_everything(make_arm_folder(Path(folder), joints), part)
        if numbers and not part:  # all other wires need the same functions, so one is enough
            call_everything(make_arm_folder(Path(folder), N_JOINTS, MICROSCRIBE))
    for path in files:
        try:
            call_everything(path)
        except ArmdError as error:
            print(f"armd: not compiled ahead: {error}", file=sys.stderr)


def remove_others() -> None:
    """Remove the libraries of other versions of armd or of Python, where this one may write."""
    own_names = {path.name for path in library.list_places()}
    for folder in library.list_written_places():
        if not (folder.is_dir() and os.access(folder, os.W_OK)):
            continue
        for path in folder.iterdir():
            if OF_A_VERSION.fullmatch(path.name):
                if path.is_dir() and path.name != library.hash_sources():
                    shutil.rmtree(path)
                elif path.is_file() and path.name not in own_names:
                    path.unlink()


def keep_in_environment() -> None:
    """Copy a library from the cache into the environment, as a cache may be emptied."""
    folder, cache = library.list_written_places()[0], library.locate_cache()
    files = [
        Path(module.__file__) for module in library.load_libraries() if module.__file__ is not None
    ]
    only_cached = [path for path in files if path.parent == cache != folder]
    if not (only_cached and library.is_usable(folder)):
        return
    with tempfile.TemporaryDirectory(dir=folder) as temporary_folder:
        for path in only_cached:
            copy = Path(shutil.copy(path, temporary_folder))
            copy.replace(folder / path.name)  # complete, or not at all


def can_link() -> bool:
    """Return whether a library can be made here."""
    if os.environ.get("ARMD_PLAIN_NUMBA"):
        return False
    try:
        from armd.compiled import numba_inside
    except ImportError:  # numba, or its internals that armd uses
        return False
    return numba_inside.can_link()


def make_library_apart() -> bool:
    """Make the library in a process of its own; return whether it succeeded.

    The first usable folder gets it. Functions for a library cannot come from numba's cache.
    """
    folder = next(filter(library.is_usable, library.list_written_places()), None)
    if folder is None:
        return False
    command = [sys.executable, "-I", "-m", __spec__.name, *sys.argv[1:], "--into", str(folder)]
    return subprocess.run(command).returncode == 0


def make_library(args: argparse.Namespace, numbers: Sequence[int]) -> int:
    """Make the library in the folder that *args* name; return the exit code."""
    if not can_link():
        print(
            "armd: found no C++ compiler, numba and setuptools to make a library", file=sys.stderr
        )
        return 2
    from armd.compiled import compiler, numba_inside
    from armd.compiled.jit import FUNCTIONS

    library.disable_library()
    compiler.keep_nothing()
    with numba_inside.skip_optimisation():
        call(args.files, numbers, args.demo)
    args.into.mkdir(parents=True, exist_ok=True)
    try:
        numba_inside.write_library(args.into / library.name_file(args.demo), FUNCTIONS)
    except ArmdError as error:
        print(f"armd: {error}", file=sys.stderr)
        return 2
    return 0


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("files", nargs="*", type=Path)
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--joints", nargs="+", type=int, help="for arms with so many")
    which.add_argument(
        "--demo", choices=library.PARTS, default="", help="a part, for the arm of `armd demo` alone"
    )
    parser.add_argument("--into", type=Path, metavar="FOLDER", help="make the library there, anew")
    parser.add_argument(
        "--anew", action="store_true", help="make the library although there is one"
    )
    parser.add_argument("--tidy", action="store_true", help="remove other versions'; nothing else")
    args = parser.parse_args()
    if args.tidy:
        remove_others()
        return 0
    numbers = (DEMO_JOINTS,) if args.demo else args.joints
    numbers = numbers or (() if args.files else range(3, 10))
    if args.into is not None:
        return make_library(args, numbers)
    keep_in_environment()
    if (args.anew or not library.load_libraries()) and can_link() and make_library_apart():
        return 0
    call(args.files, numbers, args.demo)
    return 0


if __name__ == "__main__":
    sys.exit(main())
