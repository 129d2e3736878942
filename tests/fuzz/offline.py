"""Files of the commands that judge an arm, of the simulator, recordings, and tables in Python."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from fuzz.doors import Door, check_message, check_printed, command, run
from fuzz.files import FIELD, SESSION, sealed

import armd
from armd.errors import ArmdError
from armd.files.toml_text import format_toml
from armd.simulator.__main__ import main as simulate
from armd.simulator.live.led import LedOperator, load_plan
from armd.simulator.options import make_parser, read_scenario
from armd.simulator.truth.arm import TrueArm
from support.small_arm_toml import ARM, CALIBRATION

SEALED = sealed(json.dumps(CALIBRATION).encode())
#: Names that say which tests of a verification a reading is of.
VERIFIED = [f"SPAT{k % 3 + 1}" for k in range(30)]
#: On a sphere, not on one plane.
PLACES = ((0, 0, 9), (9, 0, 0), (0, 9, 0), (-9, 0, 0), (0, -9, 0), (0, 0, -9))
SCENARIO = """serial_number = "SIM-1"
rate_hz = 200
seed = 3
seconds = 1.5
schema = "armd.scenario/1"
ambient_c = 21.0
joints = 6
faults_per_minute = 30
[[fault]]
name = "corrupted_byte"
at_s = 0.5
duration_s = 0.1
"""
PLAN = """schema = "armd.operator/1"
rest_s = 1.5
[[target]]
name = "B1"
[[target]]
name = "B2"
position_mm = [100.0, 0.0, 0.0]
[[visit]]
placement = "P1"
targets = ["B1", "B2"]
rounds = 2
position_mm = [450.0, 120.0, 200.0]
rotation_deg = [0.0, 0.0, 10.0]
"""
LENGTHS = """[artefact]
name = "bar"
target = [{name = "B1", position_mm = [0, 0, 0]}, {name = "B2", position_mm = [100, 0, 0]}]
"""


def columns(place: Path, n: int) -> dict[str, list[Any]]:
    """Readings with a tracker's points beside them, as the small arm's calibration has it."""
    rng = np.random.default_rng(2)
    q = rng.uniform(-1.5, 1.5, (n, 3))
    model = armd.Model(armd.read_arm(place / "arm.toml"), armd.read_calibration(place / "cal.json"))
    tip = model.position(q) + rng.normal(0.0, 0.01, (n, 3))
    found: dict[str, list[Any]] = {
        "time_s": [7.0 * k for k in range(n)],
        "placement": ["P1"] * n,
        "target": ["T"] * n,
    }
    found |= {f"q{k + 1}": q[:, k].round(6).tolist() for k in range(3)}
    found |= {f"{axis}_mm": tip[:, k].round(4).tolist() for k, axis in enumerate("xyz")}
    return found


def as_csv(table: dict[str, list[Any]]) -> bytes:
    rows = zip(*table.values(), strict=True)
    lines = [",".join(table), *(",".join(map(str, row)) for row in rows)]
    return ("\n".join(lines) + "\n").encode()


def asked(name: str, seeds: list[bytes], call: Callable[[bytes], object]) -> Door:
    """Functions of `import armd`: they return, or raise `armd.ArmdError` in readable words."""

    def enter(data: bytes) -> None:
        try:
            call(data)
        except ArmdError as error:
            check_message(str(error))

    return Door(name, seeds, enter)


def in_python(folder: Path, table: dict[str, list[Any]]) -> Iterator[Door]:
    arm, calibration = folder / "arm.toml", folder / "cal.json"

    def content(data: bytes) -> Any:
        try:
            return json.loads(data)
        except (ValueError, RecursionError):
            return None

    def session(data: bytes) -> None:
        if isinstance(given := content(data), dict):
            artefact, started = given.pop("artefact", None), given.pop("started", None)
            made = armd.make_session(given, arm, artefact=artefact, started=started)
            check_printed(repr(made))
            check_printed(repr(armd.evaluate(made, arm, calibration)))

    def correct(data: bytes) -> None:
        import pyarrow

        if isinstance(given := content(data), dict):
            try:
                arrow = pyarrow.table(given)
            except (pyarrow.ArrowException, TypeError, ValueError, OverflowError):
                return  # what Arrow itself refuses never comes to armd
            armd.Corrector(arm, calibration)(arrow)

    def model(data: bytes) -> None:
        if isinstance(given := content(data), dict):
            asked = armd.Model(arm, calibration)
            q = given.get("q")
            try:
                asked.position(q)
                asked.covariance(q)
                asked.compensate(q, given.get("wanted_mm"))
            except (ValueError, TypeError) as error:  # as numpy does for what is no such array
                check_message(str(error))

    angles = {"q": [table[f"q{k}"][0] for k in (1, 2, 3)], "wanted_mm": [300.0, 0.0, 200.0]}
    short = {name: values[:6] for name, values in table.items()}
    given = short | {"artefact": SESSION["artefact"], "started": "2026-03-01T09:00:00Z"}
    yield asked("make_session", [json.dumps(given).encode()], session)
    yield asked("Corrector", [json.dumps(short).encode()], correct)
    yield asked("Model", [json.dumps({k: [v] for k, v in angles.items()}).encode()], model)


def offline_doors(folder: Path) -> Iterator[Door]:
    """*folder* is filled with one sound file of each kind."""
    (folder / "s").mkdir(parents=True)
    (folder / "verify").mkdir()
    session = SESSION | {"artefact": {"name": "tracker", "target": [{"name": "T"}]}}
    seats = SESSION | {"artefact": {"name": "seats"}}
    spat = (FIELD / "xyz-only" / "spat.csv").read_bytes()
    lerobot = FIELD / "lerobot-normalised"
    contents = {
        "arm.toml": format_toml(ARM).encode(),
        "cal.json": SEALED,
        "mpe.toml": b'schema = "armd.mpe/1"\n[mpe]\nspat_max_mm = 0.5\n',
        "s/session.toml": format_toml(session).encode(),
        "verify/session.toml": format_toml(seats).encode(),
        "spat.csv": spat,
        "bar.toml": LENGTHS.encode(),
        "bar.csv": b"target;x [mm];y [mm];z [mm]\nB1;0,0;0,0;0,0\nB2;500,01;0,0;0,0\n",
        "scenario.toml": SCENARIO.encode(),
        "plan.toml": PLAN.encode(),
        "measured.csv": b"stamp_ns,x_mm,y_mm,z_mm,seq,flags\n"
        + b"".join(b"%d,%d,%d,%d,%d,0\n" % (k, *place, k) for k, place in enumerate(PLACES)),
        "lerobot.toml": (lerobot / "arm.toml").read_bytes(),
        "lerobot.csv": (lerobot / "readings.csv").read_bytes(),
        "lerobot.json": (FIELD / "lerobot-wrapped-sweep" / "whole.json").read_bytes(),
    }
    for name, data in contents.items():
        (folder / name).write_bytes(data)
    table = columns(folder, 30)
    verified = {
        name: values[: len(VERIFIED)] for name, values in table.items() if "_mm" not in name
    }
    contents["s/readings.csv"] = as_csv(table)
    contents["verify/readings.csv"] = as_csv(verified | {"target": VERIFIED})
    contents["named.csv"] = as_csv({"target": ["B1", "B2"] * 15} | {
        name: values for name, values in table.items() if name != "target" and "_mm" not in name
    })  # fmt: skip
    for name in ("s/readings.csv", "verify/readings.csv", "named.csv"):
        (folder / name).write_bytes(contents[name])

    def door(name: str, file: str, *words: str) -> Door:
        return command(folder, f"{name}, {file}", file, contents[file], *words)

    arm, under_test = ("--arm", "@arm.toml"), ("--calibration", "@cal.json")
    for file in ("verify/session.toml", "verify/readings.csv", "mpe.toml", "cal.json"):
        yield door("verify", file, "verify", "@verify", *arm, *under_test, "--mpe", "@mpe.toml",
                   "--json", "@out.json", "--report", "@out.html")  # fmt: skip
    for file in ("spat.csv", "bar.toml"):
        yield door("verify points", file, "verify", "@spat.csv", "--artefact", "@bar.toml",
                   "--json", "@out.json")  # fmt: skip
    yield door("calibrate", "s/readings.csv", "calibrate", "@s", *arm, "-o", "@out.json")
    for file in ("s/readings.csv", "s/session.toml", "cal.json"):
        yield door("diagnose", file, "diagnose", "@s", *arm, *under_test, "--json", "@out.json",
                   "--extended", "@out-extended.json")  # fmt: skip
    yield door("design", "s/readings.csv", "design", "@s", *arm, "-o", "@out.csv")
    for file in ("arm.toml", "bar.toml"):
        yield door("first design", file, "design", *arm, "--artefact", "@bar.toml", "--poses", "10",
                   "-o", "@out.csv")  # fmt: skip
    yield door("feature sphere", "measured.csv", "feature", "sphere", "@measured.csv",
               "--tip-radius-mm", "2", "--json", "@out.json")  # fmt: skip
    yield door("feature", "measured.csv", "feature", "distance", "plane=@measured.csv:1-3",
               "point=@measured.csv:4")  # fmt: skip
    for file in ("named.csv", "bar.csv"):
        yield door("import artefact", file, "import", "@named.csv", *arm, "--artefact", "@bar.csv",
                   "-o", "@out")  # fmt: skip
    for file in ("lerobot.csv", "lerobot.json"):
        yield door("import lerobot", file, "import", "@lerobot.csv", "--arm", "@lerobot.toml",
                   "--lerobot", "@lerobot.json", "-o", "@out")  # fmt: skip
    for suffix in ("urdf", "csv"):
        yield door(f"model to {suffix}", "cal.json", "model", "@arm.toml", *under_test,
                   "-o", f"@out.{suffix}")  # fmt: skip
    yield door("compensate", "cal.json", "compensate", "@named.csv", *arm, *under_test,
               "-o", "@out.csv")  # fmt: skip
    yield from interim(folder, contents)
    yield from simulator(folder, contents)
    yield from in_python(folder, table)


def interim(folder: Path, contents: dict[str, bytes]) -> Iterator[Door]:
    """One history, and every file of it damaged in turn; what an addition makes of it is undone."""
    history, kept = folder / "history", folder / "kept"
    add = ["interim", "add", str(folder / "s"), "--arm", str(folder / "arm.toml"),
           "--calibration", str(folder / "cal.json"), "--history", str(history)]  # fmt: skip
    run(add)
    if not (history / "history.jsonl").exists():
        raise ValueError("no history was begun")
    shutil.copytree(history, kept)

    def door(name: str, place: Path, words: list[str]) -> Door:
        sound = place.read_bytes()

        def enter(data: bytes) -> None:
            place.write_bytes(data)
            try:
                run(words)
            finally:
                place.write_bytes(sound)
                shutil.rmtree(history)
                shutil.copytree(kept, history)

        return Door(f"interim {name}, {place.name}", [sound], enter)

    report = ["interim", "report", "--history", str(history), "--json", str(folder / "out.json"),
              "--force"]  # fmt: skip
    for path in sorted(history.rglob("*")):
        if path.is_file():
            yield door("report", path, report)
    yield door("add", folder / "s" / "readings.csv", add)


def simulator(folder: Path, contents: dict[str, bytes]) -> Iterator[Door]:
    """What `armd simulate` reads, as far as it goes without a wire."""
    scenario, plan = folder / "scenario.toml", folder / "plan.toml"

    def check(data: bytes, path: Path) -> None:
        path.write_bytes(data)
        run(["--check", str(path)], simulate)

    def play(data: bytes) -> None:
        check(data, scenario)
        read_scenario(make_parser().parse_args(["--serial", "--scenario", str(scenario)]))

    def lead(data: bytes) -> None:
        check(data, plan)
        LedOperator(TrueArm.default(), load_plan(plan), 1)

    yield asked("scenario", [contents["scenario.toml"]], play)
    yield asked("operator's plan", [contents["plan.toml"]], lead)
