"""The command line of `armd simulate`, and the scenario that it makes."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from armd.errors import ArmdError, BadInput
from armd.files.outputs import FAULT_LOG, TRUTH, add_force, check_outputs
from armd.files.schema import load_toml, validate
from armd.files.writing import check_folder
from armd.simulator.live.faults import FAULTS, Wire, check_wire, draw_faults, parse_fault
from armd.simulator.live.scenario import Scenario
from armd.simulator.servobus.arm import N as SERVO_JOINTS
from armd.simulator.servobus.arm import list_servo_ids
from armd.simulator.truth.nominal import JOINTS
from armd.terminal.loudness import add_loudness
from armd.terminal.parser import Parser, Usage

PROGRAM = "armd simulate"
#: python-can's name of a CAN interface → its usual channel
CAN_WIRES = {
    "socketcand": "",
    "slcan": "",
    "socketcan": "vcan0",
    "udp_multicast": "239.74.163.2:43113",
}
FAULT_HELP = "faults, their usual duration in seconds and what they do:\n" + "\n".join(
    f"  {name:17}{kind.duration_s:6g}  {kind.text}" for name, kind in FAULTS.items()
)

USAGE = Usage(
    ("armd simulate --serial --seconds 60 --arm-out arm.toml",
     "armd simulate --session calibration -o measured",
     "armd simulate --twin cal.json --arm arm.toml --session-like measured/T20 -o rehearsal"),
    "how-to/simulate.md", "mm, °C, seconds; angles on the wire in counts, in sessions in rad",
)  # fmt: skip


def make_parser() -> Parser:
    command = Parser(
        prog=PROGRAM,
        description="A simulated arm as a device on the wire, in a process of its own.",
        epilog=f"{FAULT_HELP}\n\n{USAGE.text()}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    mode = command.add_mutually_exclusive_group(required=True)
    mode.add_argument("--serial", action="store_true", help="on a pty; prints its path first")
    mode.add_argument(
        "--can",
        choices=CAN_WIRES,
        help="as CANopen nodes; prints first: socketcand HOST:PORT (bus can0), else the channel",
    )
    mode.add_argument(
        "--microscribe",
        action="store_true",
        help="as a MicroScribe on a pty; prints its path first",
    )
    mode.add_argument(
        "--servo",
        choices=["feetech", "dynamixel", "dynamixel1"],
        help="as a printed arm of servos on a pty, at the line's true pace; prints its path first",
    )
    mode.add_argument(
        "--session", metavar="KIND", help="measured sessions instead: see --session KIND --help"
    )
    mode.add_argument(
        "--session-like",
        metavar="SESSION",
        type=Path,
        help="with --twin: the readings that it would have had in this session, written to -o",
    )
    mode.add_argument(
        "--check", metavar="FILE", type=Path, help="say what is wrong with a scenario"
    )
    twin = command.add_argument_group("a twin of a measured arm (docs/how-to/twin.md)")
    twin.add_argument(
        "--twin",
        metavar="CAL.json",
        type=Path,
        help="the arm errs as this calibration says, all terms included; no noise unless asked for",
    )
    twin.add_argument("--arm", metavar="ARM.toml", type=Path, help="the arm of that calibration")
    twin.add_argument(
        "--noise-from",
        metavar="DIAGNOSIS.json",
        type=Path,
        help="add the noise that armd diagnose --json found",
    )
    twin.add_argument(
        "-o", "--output", metavar="DIR", type=Path, help="folder of the session (--session-like)"
    )
    command.add_argument("--scenario", metavar="FILE", type=Path, help="TOML; options override it")
    # Options that are keys of a scenario, under the same name.
    command.add_argument(
        "--rate", dest="rate_hz", metavar="HZ", type=int, help="samples per second (1000)"
    )
    command.add_argument("--seconds", metavar="S", type=float, help="stop after S seconds (never)")
    command.add_argument(
        "--seed", metavar="N", type=int, help="of the arm, the motion and all noise (1)"
    )
    command.add_argument(
        "--joints", metavar="N", type=int, help="of the arm: 3 to 9 (6; --servo: 5 and a gripper)"
    )
    command.add_argument("--serial-number", metavar="NAME", help="what the arm says it is")
    command.add_argument("--ambient-c", metavar="C", type=float, help="air temperature, °C (20)")
    command.add_argument(
        "--warm-up-k",
        metavar="K",
        type=float,
        help="warm by K kelvin within --warm-up-s, in fast motion",
    )
    command.add_argument("--warm-up-s", metavar="S", type=float, help="(--seconds, else 20)")
    command.add_argument(
        "--sync-producer",
        action="store_true",
        default=None,
        help="on CAN: the arm sends SYNC itself, --rate times a second",
    )
    command.add_argument(
        "--baud",
        metavar="N",
        type=int,
        help="of a MicroScribe or servos: the only rate they hear (any)",
    )
    command.add_argument(
        "--fault",
        metavar="NAME@SECONDS[:DURATION]",
        action="append",
        default=[],
        help="may be given several times",
    )
    command.add_argument(
        "--operator",
        metavar="PLAN",
        type=Path,
        help="on a pty, CAN or servos: TOML with the targets that the tip is brought to"
        " (docs/how-to/measure.md)",
    )
    command.add_argument(
        "--plant",
        metavar="CAUSE@LOCATION=SIZE",
        action="append",
        default=[],
        help="on a pty or CAN: something wrong with the arm from the beginning"
        " (docs/how-to/simulate.md)",
    )
    command.add_argument(
        "--channel",
        help="socketcan: the interface (vcan0); udp_multicast: GROUP:PORT (239.74.163.2:43113)",
    )
    command.add_argument(
        "--link", metavar="PATH", type=Path, help="a symbolic link to the port, kept at a replug"
    )
    command.add_argument(
        "--truth",
        metavar="FILE",
        type=Path,
        help="true tip of every sample: <u8 seq, <f8 x, y, z; to a .jsonl as lines of JSON",
    )
    command.add_argument(
        "--fault-log", metavar="FILE", type=Path, help="what was injected, JSON lines (stderr)"
    )
    command.add_argument(
        "--arm-out", metavar="FILE", type=Path, help="write the arm's nominal arm.toml"
    )
    add_force(command)
    add_loudness(command)
    return command


def read_scenario(options: argparse.Namespace) -> Scenario:
    """Read the scenario file, overridden by the options given; raises `BadInput`."""
    file = Scenario() if options.scenario is None else load_toml(options.scenario, Scenario)
    given_options = {
        key: value
        for key, value in vars(options).items()
        if key in Scenario.model_fields and value is not None and key != "fault"
    }
    merged = file.model_dump(by_alias=True) | given_options
    scenario = validate("command line", merged, Scenario)
    wire: Wire = "serial" if options.serial else "microscribe" if options.microscribe else "can"
    if options.servo:
        wire = "servo"
    joints = scenario.joints or len(JOINTS)
    if wire == "servo":
        joints = len(list_servo_ids(scenario.joints or SERVO_JOINTS))
    faults = [*scenario.fault, *(parse_fault(text) for text in options.fault)]
    if scenario.faults_per_minute:
        if scenario.seconds is None:
            raise ArmdError("faults_per_minute wants seconds: how long the run lasts")
        faults += draw_faults(
            scenario.seed, scenario.faults_per_minute, scenario.seconds, wire, joints
        )
    check_wire(faults, wire, joints)
    return scenario.model_copy(update={"fault": faults})


def check_places(options: argparse.Namespace) -> None:
    """Raise `BadInput` unless every file of the options can and may be written."""
    outputs = {
        "--truth": (options.truth, TRUTH),
        "--fault-log": (options.fault_log, FAULT_LOG),
    }
    inputs = [options.scenario, options.twin, options.arm, options.noise_from]
    check_outputs(outputs, inputs, options.force)
    if options.link is not None:
        check_folder(options.link.parent)
        if os.path.lexists(options.link) and not options.link.is_symlink():
            actual = "no symbolic link"
            raise BadInput(
                options.link, "--link", actual, "nothing, or a link that may be replaced"
            )


def check_twin(options: argparse.Namespace) -> None:
    """Raise `BadInput` for options that a twin lacks, or that are for another arm."""
    line = "command line"
    if options.twin is None:
        needed = {"--arm": options.arm, "--noise-from": options.noise_from}
        needed["--session-like"] = options.session_like
        for name, value in needed.items():
            if value is not None:
                raise BadInput(line, "--twin", "nothing", f"a calibration: {name} is for a twin")
    elif options.arm is None:
        raise BadInput(line, "--arm", "nothing", "the arm.toml of --twin")
    if options.twin is not None:
        other_arms_options = {
            "--microscribe": options.microscribe,
            "--servo": options.servo,
            "--plant": options.plant,
            "--joints": options.joints,
            "--serial-number": options.serial_number,
            "--arm-out": options.arm_out,
        }
        for name, value in other_arms_options.items():
            if value:
                raise BadInput(line, name, "it", "none with --twin: its arm.toml says what it is")
    if (options.output is None) != (options.session_like is None):
        name = "-o" if options.output is None else "--session-like"
        raise BadInput(line, name, "nothing", "both: --session-like SESSION -o DIR")
