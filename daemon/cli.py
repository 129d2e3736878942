"""The command `armd`: one visible table of commands, each a module of its own."""

from __future__ import annotations

import argparse
import importlib
import signal
import sys
from collections.abc import Sequence

from armd import ArmdError, __version__
from armd.daemon.commands import simulate

#: name (and module in `armd.daemon.commands`) → its line in `armd --help`
COMMANDS = {
    "demo": "a simulated arm, live, no hardware needed",
    "run": "the daemon: read an arm, correct, publish",
    "accept": "take the servos' offsets found last as the arm's own",
    "simulate": "a simulated arm on the wire, or simulated measuring sessions",
    "watch": "live read-out of an arm",
    "status": "state of a running daemon, for people and scripts",
    "record": "record frames, samples and points to an MCAP file",
    "replay": "play a recording back through decoder and kernel",
    "ippdme": "an I++ DME server for inspection software",
    "stream": "text lines over TCP: one per measurement, or per point",
    "correct": "correct readings offline, same kernel",
    "calibrate": "identify geometry and thermal model from sessions",
    "evaluate": "residuals of sessions under a model",
    "verify": "ISO 10360-12 and ASME B89.4.22 results with a verdict",
    "diagnose": "what the model gets wrong, why, and the gain of mending it",
    "design": "the poses to measure next",
    "check": "validate any armd file",
    "arm": "nominal geometry of arms that people own, as an arm.toml to start from",
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code (0 done, 1 the answer is no, 2 bad usage or input)."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments[:1] == ["simulate"]:  # a program of its own, options and help included
        simulate.become(arguments[1:])
    parser = argparse.ArgumentParser(
        prog="armd", description="The open driver for articulated measuring arms."
    )
    parser.add_argument("--version", action="version", version=f"armd {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    # Only the chosen command's module is imported: `armd check` should not pay for Zenoh.
    chosen = next((word for word in arguments if not word.startswith("-")), None)
    if chosen == "run":  # before anything is read, a reload has nothing to do
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
    module = None
    for name, help_line in COMMANDS.items():
        command = commands.add_parser(name, help=help_line, description=help_line + ".")
        if name == chosen:
            module = importlib.import_module(f"armd.daemon.commands.{name}")
            module.add_arguments(command)
    namespace = parser.parse_args(arguments)
    assert module is not None  # argparse has refused everything else
    try:
        return int(module.run(namespace))
    except ArmdError as error:
        print(f"armd: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
