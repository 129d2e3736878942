"""`python -m armd.simulator`, which is `armd simulate`: an arm on a wire, or measured sessions."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence
from contextlib import ExitStack, closing
from pathlib import Path

# Ctrl-C while the rest is loaded ends the program without a traceback.
if __name__ == "__main__" and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from armd.errors import ArmdError, BadInput, describe_os_error, shorten_lines
from armd.files.inputs import read_input
from armd.files.outputs import ARM, check_same
from armd.files.schema import decode_toml, load_toml
from armd.files.writing import write_whole
from armd.simulator.canbus.device import CanArm
from armd.simulator.canbus.timeline import GRID_HZ
from armd.simulator.canbus.wires import BusEnd
from armd.simulator.life import Life, start_life
from armd.simulator.live.device_clock import set_precise_timers
from armd.simulator.live.led import OPERATOR, load_plan
from armd.simulator.live.prefetch import Prefetch
from armd.simulator.live.pty_port import PtyPort
from armd.simulator.live.scenario import Scenario
from armd.simulator.live.truth_log import FaultLog, TruthFile
from armd.simulator.microscribe.arm import make_arm_toml as microscribe_arm_toml
from armd.simulator.microscribe.device import MicroScribeDevice
from armd.simulator.options import (
    CAN_WIRES,
    PROGRAM,
    USAGE,
    check_places,
    check_twin,
    make_parser,
    read_scenario,
)
from armd.simulator.serial.device import SerialDevice
from armd.simulator.servobus.arm import N as SERVO_JOINTS
from armd.simulator.servobus.arm import make_arm_toml as servo_arm_toml
from armd.simulator.servobus.device import ServoBus
from armd.simulator.truth.nominal import JOINTS, make_arm_toml
from armd.terminal.loudness import report_own_fault, show_log
from armd.terminal.parser import Parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the simulator; return 0 for success, 2 for bad usage or input."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        if any(word.partition("=")[0] == "--session" for word in arguments):
            return measure_sessions(arguments)
        options = make_parser().parse_args(arguments)
        with show_log(options):
            return run_on_wire(options)
    except ArmdError as error:
        for fault in (error, *getattr(error, "more", ())):
            print(f"armd: {shorten_lines(fault)}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # the reader of the output has gone
        return 141
    except OSError as error:
        print(f"armd: {describe_os_error(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 0
    except Exception as error:
        return report_own_fault(error)


def _check(path: Path) -> None:
    """Check a scenario, or the plan of a simulated operator; raises `BadInput`."""
    if decode_toml(path, read_input(path)).get("schema") == OPERATOR:
        load_plan(path)
    else:
        load_toml(path, Scenario)


def run_on_wire(options: argparse.Namespace) -> int:
    """Run an arm on a wire, with the *options*; raises `BadInput`."""
    if options.check is not None:
        _check(options.check)
        return 0
    check_twin(options)
    scenario = read_scenario(options)
    if options.session_like is not None:
        from armd.simulator.twin.session import write_copy  # loaded late: the wire must not wait

        return write_copy(options, scenario.seed)
    check_places(options)
    if options.operator and options.microscribe:
        wires = "--serial, --can or --servo"
        raise BadInput("command line", "--operator", "--microscribe", wires)
    if scenario.joints is not None and options.microscribe:
        raise BadInput("--microscribe", "--joints", str(scenario.joints), "none: it has five")
    if options.serial_number is not None and options.microscribe:
        expected = "none: it has its own"
        raise BadInput("--microscribe", "--serial-number", scenario.serial_number, expected)
    if options.plant and not (options.serial or options.can):
        raise BadInput("command line", "--plant", "another wire", "--serial or --can")
    if options.arm_out is not None:
        number = scenario.serial_number
        if options.microscribe:
            text = microscribe_arm_toml()
        elif options.servo:
            text = servo_arm_toml(number, scenario.joints or SERVO_JOINTS)
        else:
            text = make_arm_toml(number, joints=scenario.joints or len(JOINTS))
        check_same(options.arm_out, text, ARM, options.force, [options.scenario])
        write_whole(options.arm_out, text)
    return run(scenario, options)


def run(scenario: Scenario, options: argparse.Namespace) -> int:
    """Run the arm on its wire, until its time is over or a signal ends it."""
    lived: Life | None = None
    if options.serial or options.can:
        lived = start_life(scenario, GRID_HZ if options.can else scenario.rate_hz, options)
        scenario = scenario.model_copy(update={"serial_number": lived.serial_number})
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    set_precise_timers()
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
            led = None
            if options.operator is not None:
                from armd.simulator.live.led import load_plan  # loaded late: the wire must not wait

                led = load_plan(options.operator)
            bus = ServoBus(options.servo, scenario, port, truth, log, options.baud, led)
            cleanup.enter_context(closing(bus))
            print(port.path, flush=True)
            bus.run()
        elif options.serial:
            assert lived is not None
            physics = cleanup.enter_context(closing(Prefetch(lived.blocks)))
            port = cleanup.enter_context(closing(PtyPort(options.link)))
            device = cleanup.enter_context(
                closing(SerialDevice(scenario, physics, port, truth, log, lived.electronics))
            )
            print(port.path, flush=True)
            device.run()
            port.drain(0.5)  # closing it at once would lose the last samples
        else:
            assert lived is not None
            physics = cleanup.enter_context(closing(Prefetch(lived.blocks)))
            wire = cleanup.enter_context(closing(make_can_wire(options)))
            arm = cleanup.enter_context(
                closing(CanArm(scenario, physics, wire, truth, log, lived.electronics))
            )
            print(wire.address, flush=True)
            arm.run()
    return 0


def make_can_wire(options: argparse.Namespace) -> BusEnd:
    """Make the wire of the frames; its modules are imported only where used."""
    match options.can:
        case "socketcand":
            from armd.simulator.canbus.socketcand import SocketcandWire

            return SocketcandWire()
        case "slcan":
            from armd.simulator.canbus.slcan import SlcanWire

            return SlcanWire(options.link)
    from armd.simulator.canbus.python_can import PythonCanWire

    return PythonCanWire(options.can, options.channel or CAN_WIRES[options.can])


def make_sessions_parser() -> Parser:
    """Make the parser of `--session KIND`."""
    from armd.simulator import sessions  # loaded late, as below

    command = Parser(
        prog=PROGRAM,
        description=sessions.__doc__,
        epilog=USAGE.text(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    sessions.add_arguments(command)
    return command


def measure_sessions(arguments: Sequence[str]) -> int:
    """Run `--session KIND`: write session folders, without a wire."""
    from armd.simulator import sessions  # loaded late: the wire must not wait

    options = make_sessions_parser().parse_args(arguments)
    with show_log(options):
        return sessions.run(options)


if __name__ == "__main__":
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.exit(main())
