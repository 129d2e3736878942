"""The command `armd`: one visible table of commands, each a module of its own."""

from __future__ import annotations

import argparse
import importlib
import io
import keyword
import signal
import sys
from collections.abc import Sequence

from armd import __version__
from armd.daemon.terminal import hush
from armd.daemon.usage import USAGE
from armd.errors import ArmdError, BadInput
from armd.printable import printable
from armd.suggest import did_you_mean

#: name (and module in `armd.daemon.commands`) → its line in `armd --help`
COMMANDS = {
    "demo": "a simulated arm, live, no hardware needed",
    "run": "the daemon: read an arm, correct, publish",
    "accept": "take the servos' offsets found last as the arm's own",
    "simulate": "a simulated arm on the wire, or simulated measuring sessions",
    "watch": "live read-out of an arm",
    "status": "state of a running daemon, for people and scripts",
    "tip": "tips: list, use, calibrate, history",
    "reload": "have a daemon read its calibration again",
    "record": "record frames, samples and points to an MCAP file",
    "replay": "play a recording back through decoder and kernel",
    "view": "the page: the arm live in a browser",
    "ippdme": "an I++ DME server for inspection software",
    "ros2": "native ROS 2 topics, without ROS on the controller",
    "fleet": "all arms that can be heard: state, rate, lost, temperatures, calibration",
    "stream": "text lines over TCP: one per measurement, or per point",
    "export": "measurements to .csv, .xyz, .ply or .qif, a recording to Foxglove's .mcap",
    "measure": "lead through a measurement, to its calibration, certificate or diagnosis",
    "feature": "lines, planes, circles, spheres, cylinders through measurements; distances, angles",
    "correct": "correct readings offline, same kernel",
    "interim": "short checks over time: in control or changed, when, and why",
    "recorrect": "measurements corrected again by a later calibration",
    "calibrate": "identify geometry and thermal model from sessions",
    "evaluate": "residuals of sessions under a model",
    "verify": "ISO 10360-12 and ASME B89.4.22 results with a verdict",
    "diagnose": "what the model gets wrong, why, and the gain of mending it",
    "design": "the poses to measure next",
    "check": "validate any armd file",
    "init": "a folder with arm.toml and armd.toml to start from",
    "import": "a table of readings (CSV, Excel) as a session, a URDF as an arm.toml",
    "schema": "JSON schemas of armd's files, for an editor",
    "doctor": "what is on this machine's ports, and what stands in the way",
    "arm": "nominal geometry of arms that people own, as an arm.toml to start from",
}


#: Exit code where nobody reads what is written: that of a program which SIGPIPE has ended.
CUT_OFF = 141


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code (0 done, 1 the answer is no, 2 bad usage or input)."""
    try:
        if argv is None and isinstance(sys.stdout, io.TextIOWrapper):
            sys.stdout.reconfigure(errors="backslashreplace")  # a terminal that knows no µ
        code = _run(list(sys.argv[1:] if argv is None else argv))
        if sys.stdout is not None:
            sys.stdout.flush()
        return code
    except ArmdError as error:
        said = "\n".join(printable(line) for line in str(error).splitlines())
        print(f"armd: {said}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        hush()
        return CUT_OFF
    except OSError as error:
        hush()
        what = " ".join((error.strerror or str(error)).split())
        print(f"armd: {error.filename or 'the system'}: found {what!r}", file=sys.stderr)
        return 2
    except MemoryError:
        print("armd: memory: found none left, expected enough for the input", file=sys.stderr)
        return 2
    except SystemExit as end:
        if isinstance(end.__context__, BrokenPipeError):  # rich's way to tell of one
            return CUT_OFF
        raise
    except KeyboardInterrupt:
        return 130


def module_of(name: str) -> str:
    """Where a command is; one that is a word of Python's own has an underscore after it."""
    return f"armd.daemon.commands.{name}{'_' * keyword.iskeyword(name)}"


def _run(arguments: list[str]) -> int:
    for number, argument in enumerate(arguments, 1):
        if any("\ud800" <= letter <= "\udfff" for letter in argument):  # bytes of another coding
            raise BadInput("command line", f"argument {number}", ascii(argument), "UTF-8 text")
    if arguments[:1] == ["simulate"]:  # a program of its own, options and help included
        from armd.daemon.commands import simulate

        simulate.become(arguments[1:])
    parser = argparse.ArgumentParser(
        prog="armd",
        description="The open driver for articulated measuring arms.",
        epilog="armd COMMAND --help: options, an example, units, exit codes, the page in docs/.",
    )
    parser.add_argument("--version", action="version", version=f"armd {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    # Only the chosen command's module is imported: `armd check` should not pay for Zenoh.
    chosen = next((word for word in arguments if not word.startswith("-")), None)
    if chosen == "run":  # before anything is read, a reload has nothing to do
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
    if chosen is not None and chosen not in COMMANDS:
        guess = did_you_mean(chosen, COMMANDS) or " (armd --help lists them)"
        raise BadInput("command line", "COMMAND", repr(chosen), f"a command of armd{guess}")
    module = None
    for name, help_line in COMMANDS.items():
        description = help_line[:1].upper() + help_line[1:] + "."
        command = commands.add_parser(name, help=help_line, description=description)
        if name == chosen:
            module = importlib.import_module(module_of(name))
            module.add_arguments(command)
            if name in USAGE:
                command.formatter_class = argparse.RawDescriptionHelpFormatter
                own = f"{command.epilog}\n\n" if command.epilog else ""
                command.epilog = own + USAGE[name].text()
    namespace = parser.parse_args(arguments)
    assert module is not None  # argparse has refused everything else
    return int(module.run(namespace))


if __name__ == "__main__":
    sys.exit(main())
