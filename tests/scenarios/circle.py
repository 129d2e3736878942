"""The circle: an arm goes wrong, and is measured, diagnosed, mended and verified over the wire.

    PYTHONPATH=tests python tests/scenarios/circle.py [--seed N] [--folder FOLDER]

A calibrated arm; then a fault that nobody is told of. A simulated operator touches seats and balls
as `armd measure` asks for them: the verification fails, the artefact's diagnosis names the cause,
its extended calibration is reloaded into the running daemon, and the verification passes. At last
the arm's twin, which errs as the extended calibration says, stands in its place under the old one:
it fails the verification as the arm did, and errs on the artefact by as much. Exit code 1 where one
of these is not so.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from programs import program
from so101 import armd

from support.program import ARMD
from support.running_daemon import free_endpoint

FAULT = "encoder_eccentricity@joint 3=3"
CAUSE, LOCATION = "encoder_eccentricity", "joint 3"
CONFIG = """\
schema = "armd.daemon/1"
arm = "arm.toml"
calibration = "calibration.json"

[driver]
kind = "serial"
port = "{port}"

[zenoh]
listen = ["{endpoint}"]

[commands]
enabled = true

[measurement]
log = false
"""
MPE = """\
schema = "armd.mpe/1"
decision = "simple"
[mpe]
spat_max_mm = 0.030
spat_2s_mm = 0.030
"""
#: The hand hurries, for this is a demonstration; a person needs four times as long.
HAND = """\
schema = "armd.operator/1"
rest_s = 0.7
press_after_s = 0.6
haste = 5.0
start_s = 3.0
"""
PRESSES = 11  # one more than is asked for at each seat, so that one may be refused
SEATS = (
    HAND
    + "".join(f'\n[[target]]\nname = "SPAT{i}"\n' for i in (1, 2, 3))
    + "".join(
        f'\n[[visit]]\nplacement = "SPAT{i}"\ntargets = ["SPAT{i}"]\nrounds = {PRESSES}\n{where}\n'
        for i, where in enumerate(
            (
                "position_mm = [250.0, 0.0, 300.0]",
                "position_mm = [0.0, 620.0, 250.0]",
                "position_mm = [150.0, -880.0, 350.0]",  # behind, joint 1 would turn all around
            ),
            1,
        )
    )
)
BEAM = """\
[artefact]
name = "short beam"
expansion_per_k = 0.5e-6
""" + "".join(
    f'\n[[artefact.target]]\nname = "{name}"\nposition_mm = {list(where)}\n'
    "standard_uncertainty_mm = 0.0001\n"
    for name, where in {
        "B1": (0.0, 0.0, 0.0),
        "B2": (150.0, 0.0, 0.0),
        "B3": (300.0, 0.0, 60.0),
        "B4": (450.0, 0.0, 0.0),
        "B5": (220.0, 180.0, 90.0),
    }.items()
)
#: Not behind the arm, where joint 1 would turn all around between two balls.
PLACEMENTS, ROUNDS = (
    {
        "P1": "position_mm = [300.0, -300.0, 100.0]\nrotation_deg = [0.0, 0.0, 40.0]",
        "P2": "position_mm = [-100.0, 450.0, 300.0]\nrotation_deg = [30.0, 0.0, 0.0]",
        "P3": "position_mm = [250.0, -600.0, 500.0]\nrotation_deg = [0.0, 50.0, 20.0]",
    },
    2,
)
BALLS = HAND.replace("start_s = 3.0", 'start_s = 3.0\nartefact = "beam.toml"') + "".join(
    f'\n[[visit]]\nplacement = "{name}"\nrounds = {ROUNDS + 1}\n{where}\n'
    for name, where in PLACEMENTS.items()
)


class Circle:
    """In *folder*, an arm of *seed*; `run` is the whole story."""

    def __init__(self, folder: Path, seed: int) -> None:
        self._folder = folder
        self._seed = str(seed)
        self._endpoint = free_endpoint()
        self._began_s = time.monotonic()
        self._boots = 0
        self._errs_by = ["--plant", FAULT]  # the arm; later its twin

    def run(self) -> dict[str, Any]:
        """Figures of the circle; printed as they come."""
        folder = self._folder
        (folder / "mpe.toml").write_text(MPE)
        (folder / "beam.toml").write_text(BEAM)
        (folder / "seats-plan.toml").write_text(SEATS)
        (folder / "balls-plan.toml").write_text(BALLS)
        self._calibrate()
        figures: dict[str, Any] = {}
        with self._daemon():
            mpe = ["--tests", "spat", "--mpe", str(folder / "mpe.toml")]
            figures["before"] = self._verified("before", mpe)
            self._measure(
                *("artefact", "balls-plan.toml", "beam"),
                *("--artefact", str(folder / "beam.toml"), "--repeats", str(ROUNDS)),
                *("--placements", ",".join(PLACEMENTS), "--then", "diagnose"),
            )
            figures["diagnosis"] = self._diagnosed()
            shutil.copyfile(folder / "beam" / "extended.json", folder / "calibration.json")
            self._say(armd("reload", "--endpoint", self._endpoint).strip())
            figures["after"] = self._verified("after", mpe)
            self._be_the_twin()
            figures["twin"] = self._verified("twin", mpe)
        figures["beam"] = self._beam_errors()
        figures["seconds"] = time.monotonic() - self._began_s
        self._say("the circle is closed" if closed(figures) else "THE CIRCLE IS NOT CLOSED")
        return figures

    def _calibrate(self) -> None:
        """While the arm was healthy."""
        measured = self._folder / "measured"
        armd("simulate", "--session", "demo", "--seed", self._seed, "-o", str(measured))
        sessions = sorted(str(path.parent) for path in measured.glob("*/session.toml"))
        arm, out = str(measured / "arm.toml"), str(self._folder / "calibration.json")
        armd("calibrate", *sessions, "--arm", arm, "-o", out, "--thermal", "1")
        shutil.copyfile(out, self._folder / "healthy.json")
        shutil.copyfile(arm, self._folder / "arm.toml")
        self._say(f"calibrated when it was healthy, from {len(sessions)} sessions; then: {FAULT}")

    @contextmanager
    def _daemon(self) -> Iterator[None]:
        folder = self._folder
        config = CONFIG.format(port=folder / "port", endpoint=self._endpoint)
        (folder / "armd.toml").write_text(config)
        with self._arm("seats-plan.toml", seconds=0.5) as arm:  # so that the port is there
            arm.wait()
        command = [*ARMD, "run", str(folder / "armd.toml")]
        with program(command, folder / "daemon.log", "armd: ready"):
            yield

    @contextmanager
    def _arm(self, plan: str, seconds: float = 600.0) -> Iterator[subprocess.Popen[str]]:
        """The arm with its fault, or its twin, in the hands of an operator who follows *plan*."""
        options = ["--serial", "--link", str(self._folder / "port"), "--seed", self._seed]
        options += ["--rate", "250", "--seconds", str(seconds), *self._errs_by]
        options += ["--operator", str(self._folder / plan)]
        # A simulator of one seed boots as the same device each time: were its samples numbered
        # from 0 again, the daemon would take them for repeated ones.
        self._boots += 1
        scenario = self._folder / f"boot-{self._boots}.toml"
        scenario.write_text(f"first_seq = {1_000_000 * self._boots}\n")
        options += ["--scenario", str(scenario)]
        with program([*ARMD, "simulate", *options], self._folder / "arm.log") as arm:
            yield arm

    def _measure(self, kind: str, plan: str, name: str, *options: str) -> int:
        """`armd measure`, with the operator; its exit code."""
        began_s = time.monotonic()
        command = [*ARMD, "measure", kind, "--endpoint", self._endpoint, "--json"]
        command += ["-o", str(self._folder / name), *options]
        refused = taken = 0
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as guide:
            try:
                assert guide.stdout is not None
                guide.stdout.readline()  # it listens
                with self._arm(plan):
                    for line in guide.stdout:
                        told = json.loads(line)
                        refused += told["event"] == "refused"
                        taken += told["event"] == "reading"
                        if told.get("complete"):
                            break
                guide.stdout.read()
            finally:
                if guide.poll() is None and not taken:
                    guide.send_signal(signal.SIGTERM)
        seconds = time.monotonic() - began_s
        self._say(f"{kind}: {taken} readings taken, {refused} refused, {seconds:.0f} s")
        return guide.returncode

    def _verified(self, name: str, options: list[str]) -> dict[str, Any]:
        code = self._measure("verify", "seats-plan.toml", name, *options)
        verdict = json.loads((self._folder / name / "verify.json").read_text())
        worst = {figure["name"]: 1e3 * figure["value_mm"] for figure in verdict["figures"].values()}
        shown = ", ".join(f"{key} {value:.0f} µm" for key, value in worst.items())
        self._say(f"verification {name}: {verdict['verdict']} ({shown}; limit 30 µm)")
        return {"code": code, **worst}

    def _be_the_twin(self) -> None:
        """From here on the twin is at the port, and the daemon has the old calibration again."""
        folder = self._folder
        self._twin = ["--twin", str(folder / "beam" / "extended.json")]
        self._twin += ["--arm", str(folder / "arm.toml")]
        self._twin += ["--noise-from", str(folder / "beam" / "diagnose.json")]
        self._errs_by = self._twin
        shutil.copyfile(folder / "healthy.json", folder / "calibration.json")
        self._say(armd("reload", "--endpoint", self._endpoint).strip())
        self._say("the arm's twin in its place, under the old calibration")

    def _beam_errors(self) -> dict[str, float]:
        """3-D RMS in µm on the beam, under the old calibration: of the arm, and of its twin."""
        folder = self._folder
        like, twin = str(folder / "beam"), str(folder / "beam-twin")
        armd("simulate", *self._twin, "--session-like", like, "-o", twin, "--seed", self._seed)
        errors = {}
        for name, session in (("arm", like), ("twin", twin)):
            result = folder / f"evaluate-{name}.json"
            options = ["--calibration", str(folder / "healthy.json"), "--json", str(result)]
            armd("evaluate", session, "--arm", str(folder / "arm.toml"), *options)
            errors[name] = float(json.loads(result.read_text())["rms_um"])
        shown = ", ".join(f"{name} {error:.1f} µm" for name, error in errors.items())
        self._say(f"beam under the old calibration, 3-D RMS: {shown}")
        return errors

    def _diagnosed(self) -> dict[str, Any]:
        result = json.loads((self._folder / "beam" / "diagnose.json").read_text())
        for finding in result["findings"]:
            gain = finding["gain"]
            self._say(
                f"diagnosis: {finding['cause']} at {finding['location']}, probability"
                f" {finding['probability']:.3f}, held out {gain['heldout_rms_um_before']:.1f} →"
                f" {gain['heldout_rms_um_after']:.1f} µm"
            )
        first = (result["findings"] or [{}])[0]
        return {key: first.get(key) for key in ("cause", "location", "probability")}

    def _say(self, text: str) -> None:
        print(f"{time.monotonic() - self._began_s:5.0f} s  {text}", flush=True)


def closed(figures: dict[str, Any]) -> bool:
    """Whether it failed before, the cause was named, and it passed afterwards; and whether the twin
    failed, and errs on the beam as the arm does, to 5 %."""
    diagnosis, beam = figures["diagnosis"], figures["beam"]
    named = (diagnosis["cause"], diagnosis["location"]) == (CAUSE, LOCATION)
    codes = [figures[name]["code"] for name in ("before", "after", "twin")]
    alike = abs(beam["twin"] / beam["arm"] - 1.0) < 0.05
    return named and codes == [1, 0, 1] and alike


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--folder", type=Path, help="kept; otherwise nothing is")
    args = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if args.folder is not None:
        args.folder.mkdir(parents=True)
        return 0 if closed(Circle(args.folder, args.seed).run()) else 1
    with tempfile.TemporaryDirectory(prefix="armd-circle-") as folder:
        return 0 if closed(Circle(Path(folder), args.seed).run()) else 1


if __name__ == "__main__":
    sys.exit(main())
