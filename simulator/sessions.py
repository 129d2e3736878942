"""`armd simulate --session KIND -o DIR`: measured sessions of an arm that is not there.

DIR gets arm.toml and one folder per session. True settings go to `--truth-out` alone, which must
lie outside the session folders.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from armd.errors import BadInput
from armd.files.outputs import (
    ARM,
    SESSION,
    SETTINGS,
    add_force,
    check_output_folder,
    check_outputs,
    check_same,
)
from armd.files.writing import write_whole
from armd.simulator.campaigns import calibration, hidden, interim, paper, verification
from armd.simulator.measured.campaign import Campaign
from armd.simulator.measured.measuring import Measured, make_session_files, measure_campaign
from armd.simulator.measured.noise import Noise
from armd.simulator.plants.causes import plant_all
from armd.simulator.plants.plant import Plant, parse_plant
from armd.simulator.printed import bench
from armd.simulator.truth.true_values import list_true_constants, list_true_expansion
from armd.terminal.arguments import parse_factor, parse_integer, parse_seed
from armd.terminal.aside import make_aside, show_bar
from armd.terminal.counted import format_count
from armd.terminal.loudness import add_loudness

KINDS: dict[str, Callable[[int, Noise], Campaign]] = {
    "paper": paper.plan_paper,
    "demo": calibration.plan_demo,
    "calibration": calibration.plan_calibration,
    "isothermal": calibration.plan_isothermal,
    "warmup": calibration.plan_warm_up,
    "seats": calibration.plan_seats,
    "verify": verification.plan_verification,
    "diagnosis": hidden.plan_diagnosis,
}
#: A printed hobby arm; its arm.toml is that of `armd arm so101`.
PRINTED = "so101"
#: Short checks of one arm, a few minutes a day over weeks.
INTERIM = "interim"
#: Options of interim checks only, by argparse's names.
OF_INTERIM = ("days", "bad", "artefact")
MEASURING = "measuring with the simulated arm …"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--session",
        metavar="KIND",
        choices=[*KINDS, INTERIM, PRINTED],
        required=True,
        help=", ".join([*KINDS, INTERIM, PRINTED]),
    )
    parser.add_argument(
        "-o", "--output", metavar="DIR", type=Path, required=True, help="folder for the sessions"
    )
    parser.add_argument("--seed", type=parse_seed, default=1, help="which arm, artefact and noise")
    parser.add_argument(
        "--noise",
        type=parse_factor,
        default=1.0,
        metavar="FACTOR",
        help="0: readings without noise",
    )
    parser.add_argument(
        "--plant",
        metavar="CAUSE@LOCATION=SIZE",
        action="append",
        default=[],
        help="something wrong with the arm, such as 'encoder_eccentricity@joint 3=0.8'; of interim"
        " checks from a day on ('encoder_slip@joint 3=15@12'), or growing with use from that day to"
        " its size on the last ('joint_backlash@joint 2=8@12+')",
    )
    parser.add_argument(
        "--days",
        type=lambda text: parse_integer(text, 1, 2000),
        metavar="N",
        help="interim: so many checks, one a day (40)",
    )
    parser.add_argument(
        "--artefact", choices=list(interim.ARTEFACTS), help="interim: what they are made on (bar)"
    )
    parser.add_argument(
        "--bad",
        action="append",
        metavar="KIND@DAY",
        help=f"interim: a check that is bad itself, KIND one of {', '.join(interim.BAD)}",
    )
    parser.add_argument(
        "--truth-out", metavar="FILE", type=Path, help="write the true settings to a JSON file"
    )
    add_force(parser)
    add_loudness(parser)


def run(args: argparse.Namespace) -> int:
    folder: Path = args.output
    if args.truth_out is not None and folder.resolve() in args.truth_out.resolve().parents:
        raise BadInput(
            args.truth_out, "--truth-out", f"a place inside {folder}", "one outside the sessions"
        )
    check_output_folder(folder)
    if args.session != INTERIM:
        for option in OF_INTERIM:
            if getattr(args, option) is not None:
                raise BadInput(
                    f"--session {args.session}", f"--{option}", "it", "it not: interim's"
                )
    check_outputs({"--truth-out": (args.truth_out, SETTINGS)}, [], args.force)
    if args.session == INTERIM:
        return _interim(args)
    if args.session == PRINTED:
        if args.plant or args.noise != 1.0:
            raise BadInput("--session so101", "--plant or --noise", "one", "neither of them")
        with show_bar(make_aside(args), MEASURING) as show_share:
            printed, texts, readings = bench.measure(
                args.seed, lambda share: show_share(MEASURING, share)
            )
        texts = {"arm.toml": _printed_drawing(), **texts}
        _write_files({folder / name: text for name, text in texts.items()}, folder, args.force)
        if args.truth_out is not None:
            write_whole(args.truth_out, json.dumps(printed.as_json(), indent=1) + "\n")
        print(f"3 sessions, {readings} readings in {folder}")
        return 0
    noise = Noise().scaled(args.noise)
    campaign = KINDS[args.session](args.seed, noise)
    plants = [parse_plant(text) for text in args.plant]
    campaign = plant_all(campaign, plants, np.random.default_rng([args.seed, 0x9147]))
    with make_aside(args).status(MEASURING):
        measured = write_campaign(folder, campaign, args.seed, args.force)
    if args.truth_out is not None:
        truth = describe_truth(campaign, plants, measured)
        write_whole(args.truth_out, json.dumps(truth, indent=1) + "\n")
    total = format_count(sum(m.n for m in measured), "reading")
    print(f"{format_count(len(measured), 'session')}, {total} in {folder}")
    return 0


def _printed_drawing() -> str:
    """Return the arm.toml of `armd arm so101`, which an owner would have."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "arm.toml"
        command = [sys.executable, "-P", "-m", "armd", "arm", PRINTED, "-o", str(path)]
        subprocess.run(command, capture_output=True, check=True)
        return path.read_text(encoding="utf-8")


def _interim(args: argparse.Namespace) -> int:
    """Write a history of checks, and its true settings."""
    days = args.days or 40
    history = interim.CheckSeries(
        days,
        tuple(interim.parse_happening(text, float(days // 2)) for text in args.plant),
        tuple(interim.parse_bad(text) for text in args.bad or ()),
        args.artefact or "bar",
    )
    noise = Noise().scaled(args.noise)
    measured = []
    with show_bar(make_aside(args), MEASURING) as show_share:
        for session in interim.measure_checks(history, args.seed, noise):
            measured.append(session)
            show_share(MEASURING, len(measured) / days)
    campaign = interim.plan_interim(args.seed, noise, history.artefact)
    _write_measured(args.output, campaign.arm_toml, measured, args.force)
    if args.truth_out is not None:
        truth = describe_truth(campaign, [h.plant for h in history.happenings], measured)
        truth["happenings"] = [
            {
                "cause": h.plant.cause,
                "location": h.plant.location,
                "size": h.plant.size,
                "since": interim.find_instant(
                    interim.find_first_day(h, interim.use(days, args.seed))
                ).isoformat(),
                "grows": h.grows,
            }
            for h in history.happenings
        ]
        truth["bad"] = [{"kind": kind, "day": day} for kind, day in history.bad]
        write_whole(args.truth_out, json.dumps(truth, indent=1) + "\n")
    readings = format_count(sum(m.n for m in measured), "reading")
    print(f"{format_count(len(measured), 'session')}, {readings} in {args.output}")
    return 0


def write_campaign(
    folder: Path, campaign: Campaign, seed: int, force: bool = False
) -> list[Measured]:
    """Measure *campaign* and write arm.toml and its sessions under *folder*.

    Raises `BadInput`, and writes nothing, if one of the files exists with another content, because
    a user may have measured it.
    """
    measured = list(measure_campaign(campaign, np.random.default_rng([seed, 0x5E55])))
    _write_measured(folder, campaign.arm_toml, measured, force)
    return measured


def _write_measured(folder: Path, arm_toml: str, measured: Sequence[Measured], force: bool) -> None:
    files = {folder / "arm.toml": arm_toml} | {
        folder / session.plan.name / name: text
        for session in measured
        for name, text in make_session_files(session).items()
    }
    _write_files(files, folder, force)


def _write_files(files: dict[Path, str], folder: Path, force: bool) -> None:
    for path, text in files.items():
        check_output_folder(path.parent)
        if path.parent.is_dir():
            check_same(path, text, ARM if path.parent == folder else SESSION, force)
    for path, text in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text)


def describe_truth(
    campaign: Campaign, plants: Sequence[Plant], measured: Sequence[Measured]
) -> dict[str, Any]:
    """Return the true settings as plain data: constants at the reference temperature, expansion,
    poses.

    Constants have the names of arm.toml's parameters with the joint's number (rad, mm).
    """
    arm = campaign.rig.arm
    return {
        "plants": [f"{plant.cause}@{plant.location}={plant.size}" for plant in plants],
        "constants": list_true_constants(arm),
        "expansion_per_k": [
            {"parameter": name, "sensor": sensor, "mm_per_k": rate}
            for name, sensor, rate in list_true_expansion(arm)
        ],
        "growth_per_k2": arm.materials.growth.tolist(),
        "sessions": {
            session.plan.name: {
                "placements": {
                    placement.name: {
                        "rotation": placement.rotation.tolist(),
                        "origin_mm": placement.origin_mm.tolist(),
                    }
                    for placement in session.placements
                },
                "tip_mm": session.tip_mm.tolist(),
                "link_c": session.conditions.link_c.tolist(),
            }
            for session in measured
        },
    }
