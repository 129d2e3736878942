"""docs/tutorials/so101.md over the wire: a simulated SO-101 on its servo bus, and an operator.

    python tests/scenarios/so101_live.py [--seed N] [--folder FOLDER]

`armd arm`, `armd run`, `armd measure`: the plate in several places, the same in others for the
check, three cones for the verification; between them `armd calibrate` and `armd diagnose`. Every
point came through servo packets on a pseudo-terminal. Exit code 1 where a step does not help, or
the verdict is not passed.
"""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import combinations
from pathlib import Path

import numpy as np
from programs import program
from so101 import ARMD, MPE, armd, identified, main

from armd.simulator.printed.bench import CALLIPER_MM, CONES_MM, SEATS_MM
from support.running_daemon import free_endpoint

#: The hand hurries; a person takes half an hour.
HAND = """\
schema = "armd.operator/1"
rest_s = 1.4
press_after_s = 1.1
haste = 3.0
start_s = 4.0
miss_um = 20.0
again = true
"""
#: A hand presses every three seconds: after so long without a word something is wrong. It may
#: begin anew, but not for ever.
SILENT_S, SILENCES = 60.0, 3
LOG_LINES = 8
REFUSALS = 60  # a busy machine does not hear each press, and takes the next one for it
PLACES = {"calibrate": 4, "check": 3}
ROUNDS = {"calibrate": 4, "check": 2}


def _visit(placement: str, target: str, where: str) -> str:
    words = f'\n[[visit]]\nplacement = "{placement}"\ntargets = ["{target}"]\n'
    return words + f"position_mm = {where}\n"


class Bench:
    """An arm of *seed*, its daemon and its plate, in *folder*."""

    def __init__(self, folder: Path, seed: int) -> None:
        self._folder, self._seed = folder, seed
        self._rng = np.random.default_rng([seed, 0x11FE])
        self._plate = {n: np.array(at) + self._rng.normal(0, 0.1, 3) for n, at in SEATS_MM.items()}
        self._endpoint = free_endpoint()
        os.environ["STATE_DIRECTORY"] = str(folder / "state")

    def run(self) -> dict[str, float]:
        """RMS of the check under each model, µm, and whether the verification passed."""
        folder, arm = self._folder, str(self._folder / "arm.toml")
        with self._moving("verify", seconds=2.0) as moving:  # so that the port is there
            moving.wait()
        armd("arm", "so101", "--port", str(folder / "port"), "-o", arm)
        config = (folder / "armd.toml").read_text()
        config += "trigger = { id = 6, pressed_below = 1900 }\n"
        config += f'\n[zenoh]\nlisten = ["{self._endpoint}"]\n'
        self._write_plate()
        with self._daemon(config):
            for name in PLACES:
                places = ",".join(f"P{i + 1}" for i in range(PLACES[name]))
                plate = str(folder / "plate.toml")
                options = ["--artefact", plate, "--placements", places, "--then", "none"]
                self._measure("artefact", name, *options, "--repeats", str(ROUNDS[name]))
        figures = identified(folder, arm, str(folder / "calibrate"), str(folder / "check"))
        (folder / "mpe.toml").write_text(MPE)
        calibrated = config.replace(
            "\n\n[driver]", '\ncalibration = "extended.json"\n\n[driver]', 1
        )
        with self._daemon(calibrated):
            mpe = ("--tests", "spat", "--mpe", str(folder / "mpe.toml"))
            figures["passed"] = float(self._measure("verify", "verify", *mpe) == 0)
        verdict = json.loads((folder / "verify" / "verify.json").read_text())
        for figure in verdict["figures"].values():
            print(f"{figure['name']}: {figure['value_mm']:.2f} mm", flush=True)
        print(f"verdict: {verdict['verdict']}")
        return figures

    def _write_plate(self) -> None:
        """As somebody with a calliper describes it."""
        text = '[artefact]\nname = "printed plate with three cones"\n'
        text += "".join(f'\n[[artefact.target]]\nname = "{name}"\n' for name in self._plate)
        for a, b in combinations(self._plate, 2):
            length = float(np.linalg.norm(self._plate[a] - self._plate[b]))
            length += self._rng.normal(0, CALLIPER_MM)
            text += f'\n[[artefact.distance]]\nbetween = ["{a}", "{b}"]\n'
            text += f"length_mm = {length:.2f}\nstandard_uncertainty_mm = {CALLIPER_MM}\n"
        (self._folder / "plate.toml").write_text(text)

    def _stations(self, name: str) -> list[str]:
        """One visit each, in the order in which `armd measure` asks for them."""
        if name == "verify":
            return [_visit(cone, cone, "[0.0, 0.0, 0.0]") for cone in CONES_MM for _ in range(10)]
        stations = []
        for i in range(PLACES[name]):
            around = (i + 0.5) / PLACES[name] * 2.2 - 1.1
            radius, height = (215.0, 270.0)[i % 2], (30.0, 80.0, 130.0)[i % 3]
            turn = np.degrees(around) + (-20.0, 25.0, 0.0)[i % 3]
            c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
            middle = np.array([[c, -s], [s, c]]) @ np.mean(list(self._plate.values()), axis=0)[:2]
            x, y = radius * np.cos(around) - middle[0], radius * np.sin(around) - middle[1]
            where = f"[{x:.1f}, {y:.1f}, {height}]\n"
            where += f"rotation_deg = [{(0.0, 15.0)[i % 2]}, 0.0, {turn:.1f}]"
            stations += [
                _visit(f"P{i + 1}", seat, where)
                for _ in range(ROUNDS[name])
                for seat in self._plate
            ]
        return stations

    def _plan(self, name: str, done: int) -> str:
        """Where seats truly are, and the readings that remain."""
        points = CONES_MM if name == "verify" else self._plate
        targets = "".join(
            f'\n[[target]]\nname = "{target}"\nposition_mm = {np.array(at).tolist()}\n'
            for target, at in points.items()
        )
        return HAND + targets + "".join(self._stations(name)[done:])

    @contextmanager
    def _daemon(self, config: str) -> Iterator[None]:
        path = self._folder / "armd.toml"
        path.write_text(config)
        with program([*ARMD, "run", str(path)], self._folder / "daemon.log", "armd: ready"):
            yield

    @contextmanager
    def _moving(
        self, name: str, done: int = 0, seconds: float = 900.0
    ) -> Iterator[subprocess.Popen[str]]:
        """The arm, in the hands of an operator who measures *name*, after *done* readings."""
        plan = self._folder / f"{name}-plan.toml"
        plan.write_text(self._plan(name, done))
        options = ["--servo", "feetech", "--link", str(self._folder / "port")]
        options += ["--seed", str(self._seed), "--seconds", str(seconds), "--operator", str(plan)]
        with program([*ARMD, "simulate", *options], self._folder / "arm.log") as arm:
            yield arm

    def _measure(self, kind: str, name: str, *options: str) -> int:
        """`armd measure`, with the operator; its exit code."""
        began_s = time.monotonic()
        command = [*ARMD, "measure", kind, "--endpoint", self._endpoint, "--json"]
        command += ["-o", str(self._folder / name), *options]
        refused = taken = silences = 0
        with subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as guide:
            try:
                assert guide.stdin is not None
                lines = Lines(guide)
                said = lines.next(SILENT_S)  # it listens
                complete = False
                while not complete:
                    with self._moving(name, taken) as hand:
                        while True:
                            line = lines.next(SILENT_S)
                            if line == "":  # a hand that begins anew measures what remains
                                silences += 1
                                print(self._silence(name, taken, hand, guide, said), flush=True)
                                if silences == SILENCES or guide.poll() is not None:
                                    raise SystemExit(f"{name}: no reading and no refusal")
                                break
                            said, told = line, json.loads(line)
                            taken += told["event"] == "reading"
                            taken -= told["event"] == "deleted"
                            if complete := bool(told.get("complete")):
                                break
                            if told["event"] == "refused":
                                refused += 1
                                print(f"{name}: refused: {told['text']}", flush=True)
                                if refused > REFUSALS:
                                    raise SystemExit(f"{name}: {refused} refusals")
                                if "delete" in told["text"]:  # a person does what is advised
                                    guide.stdin.write("d\n")
                                    guide.stdin.flush()
                                    continue
                                if told["reason"] != "unmoved":  # else the next posture is due
                                    break  # the hand is told, and does it again
                            if told["event"] == "deleted":
                                break
                guide.wait()
            except BaseException:
                guide.send_signal(signal.SIGTERM)  # whose end is waited for
                raise
        seconds = time.monotonic() - began_s
        print(f"{name}: {taken} readings, {refused} refused, {seconds:.0f} s", flush=True)
        return guide.returncode

    def _silence(
        self, name: str, taken: int, hand: subprocess.Popen[str], guide: subprocess.Popen[str],
        said: str,
    ) -> str:  # fmt: skip
        """What there is to know where nothing was said of a press."""
        text = f"{name}: nothing said for {SILENT_S:.0f} s, after {taken} readings; exit codes: "
        text += f"hand {hand.poll()}, guide {guide.poll()}; the guide's last line: {said.strip()}"
        for log in ("daemon.log", "arm.log"):
            path = self._folder / log
            last = path.read_text().splitlines()[-LOG_LINES:] if path.exists() else []
            text += "".join(f"\n  {log}: {line}" for line in last)
        return text


class Lines:
    """What a program says, line by line, waited for no longer than one wants to."""

    def __init__(self, program: subprocess.Popen[str]) -> None:
        self._said: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._listen, args=(program.stdout,), daemon=True).start()

    def _listen(self, stream: Iterable[str]) -> None:
        for line in stream:
            self._said.put(line)
        self._said.put("")  # its end

    def next(self, within_s: float) -> str:
        """A line; "" where none comes any more, or none in this time."""
        try:
            return self._said.get(timeout=within_s)
        except queue.Empty:
            return ""


def run(folder: Path, seed: int) -> dict[str, float]:
    return Bench(folder, seed).run()


if __name__ == "__main__":
    sys.exit(main(run))
