"""Effects planted into the readings of four real robots; sets given with their right answers."""

from __future__ import annotations

import csv
import json
import re
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from hidden.frozen.case import Cause, Truth, rounded, write_truth
from hidden.frozen.oracle import F64
from hidden.frozen.real_units import compute_noise_units
from real.convert import convert

ARC_SECOND = np.pi / 180 / 3600
FIELD = Path(__file__).parents[2] / "field" / "thermal"
SETS = ("expansion", "joint-thermal", "nonlinear", "lag")
Rows = list[dict[str, str]]


@dataclass(frozen=True)
class Robot:
    folder: str  # of convert's output
    before: str  # the session for the model under test; with the other it is the same: half of it
    since: str
    joints: tuple[int, ...]
    #: A disc 50 mm wide that sits 0.1 mm off shows 900″; `dinova_1` errs by more than that.
    arcsec: float


ROBOTS = (
    Robot("ur10", "B-train", "B-heldout", (1, 2, 3, 4), 600.0),
    Robot("dinova_1", "seats", "seats", (2, 3, 4), 3600.0),
    Robot("panda_3", "seats", "seats", (2, 3, 4), 250.0),
    Robot("kuka_14", "seats", "seats", (2, 3, 4), 300.0),
)
ORDERS = {"encoder_eccentricity": 1, "encoder_ellipticity": 2, "encoder_periodic": 0}


def write_real(folder: Path, kind: str, seed: int, rng: np.random.Generator, number: int) -> Truth:
    """Plant a wave of one encoder into half of a robot's readings. Nobody knows what else is wrong
    with it: other findings do not count."""
    robot = ROBOTS[number % len(ROBOTS)]
    cause = list(ORDERS)[(number // len(ROBOTS)) % len(ORDERS)]
    joint, phase = int(rng.choice(robot.joints)), float(rng.uniform(0, 2 * np.pi))
    order = ORDERS[cause] or int(rng.integers(3, 9))
    size = robot.arcsec * float(np.exp(rng.normal(0.0, 0.3)))

    def read(rows: Rows) -> F64:
        return np.array([float(row[f"q{joint}"]) for row in rows])

    def wave(rows: Rows) -> F64:
        return size * ARC_SECOND * np.sin(order * read(rows) - phase)

    def plant(rows: Rows) -> Rows:
        shown = read(rows) + wave(rows)
        return [row | {f"q{joint}": f"{q:.9f}"} for row, q in zip(rows, shown, strict=True)]

    with tempfile.TemporaryDirectory() as made:
        convert(Path(made))
        source = Path(made) / robot.folder
        text = (source / "arm.toml").read_text(encoding="utf-8")
        (folder / "arm.toml").write_text(_rounded(text), encoding="utf-8")
        first, since = _read(source / robot.before), _read(source / robot.since)
        if robot.before == robot.since:
            half = rng.permutation(len(first)) < len(first) // 2
            first, since = _picked(first, half), _picked(first, ~half)
        shown = rng.permutation(len(since)) < len(since) * 2 // 3
        _write(folder / "before-1", source / robot.before, first)
        diagnosed = _picked(since, shown)
        _write(folder / "session-1", source / robot.since, plant(diagnosed))
        _write(folder / "further-1", source / robot.since, plant(_picked(since, ~shown)))
    units = compute_noise_units(folder / "arm.toml", first, diagnosed, joint, wave(diagnosed))
    where = f"joint {joint}"
    truth = Truth(
        kind, seed, f"{robot.folder}: {cause} {where} {size:.0f}″, {order} a turn",
        (Cause(cause, where, rounded(units), variables=(f"q{joint}",)),), "diagnose",
        count_foreign=False,
    )  # fmt: skip
    write_truth(folder, truth)
    return truth


def _rounded(text: str) -> str:
    """Numbers to nine digits, without a negative zero or half turn: what reads drawings may change
    there, and another processor has -180° where this one has 180°."""
    number = re.compile(r"-?\d+\.\d+(e-?\d+)?")
    text = number.sub(lambda found: repr(float(f"{float(found[0]):.9g}") + 0.0), text)
    return re.sub(r"_deg = -180\.0$", "_deg = 180.0", text, flags=re.MULTILINE)


def _read(session: Path) -> Rows:
    with (session / "readings.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _picked(rows: Rows, which: np.ndarray) -> Rows:
    return [row for row, take in zip(rows, which, strict=True) if take]


def _write(folder: Path, like: Path, rows: Rows) -> None:
    folder.mkdir()
    shutil.copy(like / "session.toml", folder / "session.toml")
    with (folder / "readings.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


def write_field(folder: Path, kind: str, seed: int, _: np.random.Generator, number: int) -> Truth:
    """One of the sets of tests/field/thermal."""
    source = FIELD / SETS[number % len(SETS)]
    told = json.loads((source / "answer.json").read_text(encoding="utf-8"))
    shutil.copy(source / "arm.toml", folder / "arm.toml")
    for part, name in (("calib", "before"), ("train", "session"), ("holdout", "further")):
        for number_, session in enumerate(sorted((source / part).glob("*")), 1):
            shutil.copytree(session, folder / f"{name}-{number_}")
    names = tuple((c, where) for c, where in told["names"])
    cause = Cause(told["cause"], told["location"], 20.0, names, variables=tuple(told["variables"]))
    truth = Truth(
        kind, seed, source.name, (cause,), "calibrate" if (source / "calib").exists() else "",
        told["noise_um"], told["oracle_um"], holdout_given=True,
    )  # fmt: skip
    write_truth(folder, truth)
    return truth


Write = Callable[[Path, str, int, np.random.Generator, int], Truth]
KINDS: dict[str, tuple[Write, int]] = {"real": (write_real, 12), "field": (write_field, 4)}
