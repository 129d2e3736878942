"""`python -m armd.simulator`, which is `armd simulate`: an arm on a wire, or measured sessions."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing
from pathlib import Path

# Ctrl-C while the rest is loaded ends the program without a traceback.
if __name__ == "__main__" and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from armd.errors import ArmdError, BadInput
from armd.files import check_folder, write_whole
from armd.outputs import ARM, FAULT_LOG, TRUTH, add_force, check_outputs, check_same
from armd.schema import load_toml, validate
from armd.simulator.ahead import Ahead
from armd.simulator.books import FaultLog, TruthFile
from armd.simulator.canbus.device import CanArm
from armd.simulator.canbus.timeline import GRID_HZ
from armd.simulator.canbus.wires import Wire
from armd.simulator.crystal import precise_timers
from armd.simulator.faults import FAULTS, check_wire, parse_fault, random_faults
from armd.simulator.faults import Wire as WireName
from armd.simulator.microscribe.device import MicroScribeDevice
from armd.simulator.operator import Hand, Operator
from armd.simulator.physics import Block, WarmUp, blocks
from armd.simulator.pty_port import PtyPort
from armd.simulator.scenario import Scenario
from armd.simulator.serial_device import SerialDevice
from armd.simulator.servobus.arm import arm_toml as servo_arm_toml
from armd.simulator.servobus.device import ServoBus
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.nominal import arm_toml

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


def parser() -> argparse.ArgumentParser:
    command = argparse.ArgumentParser(
        prog=PROGRAM,
        description="A simulated arm as a device on the wire, in a process of its own.",
        epilog=FAULT_HELP,
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
        choices=["feetech", "dynamixel"],
        help="as a printed arm of six servos on a pty, at the line's true pace; prints its path"
        " first",
    )
    mode.add_argument(
        "--session", metavar="KIND", help="measured sessions instead: see --session KIND --help"
    )
    mode.add_argument(
        "--check", metavar="FILE", type=Path, help="say what is wrong with a scenario"
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
        help="on a pty or CAN: TOML with the targets that the tip is brought to (docs/measure.md)",
    )
    command.add_argument(
        "--plant",
        metavar="CAUSE@LOCATION=SIZE",
        action="append",
        default=[],
        help="on a pty or CAN: something wrong with the arm from the beginning (docs/simulator.md)",
    )
    command.add_argument(
        "--channel",
        help="socketcan: the interface (vcan0); udp_multicast: GROUP:PORT (239.74.163.2:43113)",
    )
    command.add_argument(
        "--link", metavar="PATH", type=Path, help="a symbolic link to the port, kept at a replug"
    )
    command.add_argument(
        "--truth", metavar="FILE", type=Path, help="true tip of every sample: <u8 seq, <f8 x, y, z"
    )
    command.add_argument(
        "--fault-log", metavar="FILE", type=Path, help="what was injected, JSON lines (stderr)"
    )
    command.add_argument(
        "--arm-out", metavar="FILE", type=Path, help="write the arm's nominal arm.toml"
    )
    add_force(command)
    return command


def read_scenario(options: argparse.Namespace) -> Scenario:
    """The scenario file, overridden by the options given; raises `BadInput`."""
    file = Scenario() if options.scenario is None else load_toml(options.scenario, Scenario)
    given = {
        key: value
        for key, value in vars(options).items()
        if key in Scenario.model_fields and value is not None and key != "fault"
    }
    merged = file.model_dump(by_alias=True) | given
    scenario = validate("command line", merged, Scenario)
    wire: WireName = "serial" if options.serial else "microscribe" if options.microscribe else "can"
    if options.servo:
        wire = "servo"
    faults = [*scenario.fault, *(parse_fault(text) for text in options.fault)]
    if scenario.faults_per_minute:
        if scenario.seconds is None:
            raise ArmdError("faults_per_minute wants seconds: how long the run lasts")
        faults += random_faults(scenario.seed, scenario.faults_per_minute, scenario.seconds, wire)
    check_wire(faults, wire)
    return scenario.model_copy(update={"fault": faults})


def main(argv: Sequence[str] | None = None) -> int:
    """Run the simulator; 0 done, 2 bad usage or input."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        if any(word.partition("=")[0] == "--session" for word in arguments):
            return measured_sessions(arguments)
        options = parser().parse_args(arguments)
        if options.check is not None:
            load_toml(options.check, Scenario)
            return 0
        scenario = read_scenario(options)
        check_places(options)
        if (options.operator or options.plant) and not (options.serial or options.can):
            found = "--operator" if options.operator else "--plant"
            raise BadInput("command line", found, "another wire", "--serial or --can")
        if options.arm_out is not None:
            drawn = servo_arm_toml if options.servo else arm_toml
            text = drawn(scenario.serial_number)
            check_same(options.arm_out, text, ARM, options.force, [options.scenario])
            write_whole(options.arm_out, text)
        return run(scenario, options)
    except ArmdError as error:
        for fault in (error, *getattr(error, "more", ())):
            print(f"armd: {fault}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # whoever started it has left
        return 141
    except OSError as error:
        what = " ".join((error.strerror or str(error)).split())
        print(f"armd: {error.filename or 'the system'}: found {what!r}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 0


def check_places(options: argparse.Namespace) -> None:
    """Raise `BadInput` unless every file of the options can and may be written."""
    outputs = {
        "--truth": (options.truth, TRUTH),
        "--fault-log": (options.fault_log, FAULT_LOG),
    }
    check_outputs(outputs, [options.scenario], options.force)
    if options.link is not None:
        check_folder(options.link.parent)
        if os.path.lexists(options.link) and not options.link.is_symlink():
            found = "no symbolic link"
            raise BadInput(options.link, "--link", found, "nothing, or a link that may be replaced")


def run(scenario: Scenario, options: argparse.Namespace) -> int:
    """The arm on its wire, until its time is over or a signal ends it."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    precise_timers()
    with ExitStack() as cleanup:
        truth = cleanup.enter_context(closing(TruthFile(options.truth)))
        log = cleanup.enter_context(closing(FaultLog(options.fault_log)))
        if options.microscribe:
            port = cleanup.enter_context(closing(PtyPort(options.link)))
            scribe = cleanup.enter_context(
                closing(MicroScribeDevice(scenario, port, truth, log, options.baud))
            )
            print(port.path, flush=True)
            scribe.run()
        elif options.servo:
            port = cleanup.enter_context(closing(PtyPort(options.link)))
            bus = ServoBus(options.servo, scenario, port, truth, log, options.baud)
            cleanup.enter_context(closing(bus))
            print(port.path, flush=True)
            bus.run()
        elif options.serial:
            physics = cleanup.enter_context(
                closing(Ahead(life(scenario, scenario.rate_hz, options)))
            )
            port = cleanup.enter_context(closing(PtyPort(options.link)))
            device = cleanup.enter_context(
                closing(SerialDevice(scenario, physics, port, truth, log))
            )
            print(port.path, flush=True)
            device.run()
            port.drain(0.5)  # a port closed at once takes the last samples with it
        else:
            physics = cleanup.enter_context(closing(Ahead(life(scenario, GRID_HZ, options))))
            wire = cleanup.enter_context(closing(can_wire(options)))
            arm = cleanup.enter_context(closing(CanArm(scenario, physics, wire, truth, log)))
            print(wire.address, flush=True)
            arm.run()
    return 0


def can_wire(options: argparse.Namespace) -> Wire:
    """What carries the frames; the modules behind it are imported only where used."""
    match options.can:
        case "socketcand":
            from armd.simulator.canbus.socketcand import SocketcandWire

            return SocketcandWire()
        case "slcan":
            from armd.simulator.canbus.slcan import SlcanWire

            return SlcanWire(options.link)
    from armd.simulator.canbus.python_can import PythonCanWire

    return PythonCanWire(options.can, options.channel or CAN_WIRES[options.can])


def life(scenario: Scenario, rate_hz: int, options: argparse.Namespace) -> Iterator[Block]:
    """The physics of a scenario, *rate_hz* times a second; raises `BadInput` for a plan or a plant
    that cannot be."""
    warm_up = None
    if scenario.warm_up_k is not None:
        warm_up = WarmUp(scenario.warm_up_k, scenario.warm_up_s or scenario.seconds or 20.0)
    arm = TrueArm.default(scenario.seed)
    if options.plant:
        from armd.simulator.plants.live import planted  # the wire must not wait for it

        arm = planted(arm, options.plant, scenario.seed)
    hand: Hand = Operator(arm, scenario.seed)
    if options.operator is not None:
        from armd.simulator.led import LedOperator, load_plan

        hand = LedOperator(arm, load_plan(options.operator), scenario.seed)
    return blocks(arm, hand, rate_hz, scenario.ambient_c, warm_up)


def measured_sessions(arguments: Sequence[str]) -> int:
    """`--session KIND`: no wire, but session folders."""
    from armd.simulator import sessions  # the wire must not wait for it

    command = argparse.ArgumentParser(prog=PROGRAM, description=sessions.__doc__)
    sessions.add_arguments(command)
    return sessions.run(command.parse_args(arguments))


if __name__ == "__main__":
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.exit(main())
