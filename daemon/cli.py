"""The command `armd`: reads the command line and runs one command, each in its own module."""

from __future__ import annotations

import argparse
import gc
import importlib
import io
import keyword
import signal
import sys
import threading
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING

from armd import __version__
from armd.compensation.freed import collect_seldom
from armd.daemon.commands.groups import COMMANDS, FOLDERS, format_grouped_help
from armd.daemon.commands.terminal import drop_output
from armd.daemon.commands.usage import USAGE
from armd.errors import ArmdError, BadInput, describe_os_error, shorten_lines
from armd.terminal.loudness import add_loudness, report_own_fault, show_log
from armd.terminal.parser import Parser
from armd.terminal.suggest import suggest

if TYPE_CHECKING:
    from armd.daemon.commands.added import AddedCommand

#: Packages that a controller may lack, because a daemon and its subscribers never need them.
OFFLINE = frozenset({"llvmlite", "matplotlib", "numba", "pyarrow", "scipy", "threadpoolctl"})
#: Python modules that Windows lacks; code for an arm's wires and for serving needs them.
POSIX = frozenset({"fcntl", "grp", "pty", "pwd", "resource", "termios", "tty"})
#: Exit code when the reader of the output is gone: that of a program ended by SIGPIPE.
CUT_OFF = 141


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return the exit code.

    It is 0 for done, 1 if the answer is no, 2 for bad usage or input, 70 for a bug of armd.
    """
    try:
        if argv is None and isinstance(sys.stdout, io.TextIOWrapper):
            sys.stdout.reconfigure(errors="backslashreplace")  # a terminal without µ
        code = _run(list(sys.argv[1:] if argv is None else argv))
        if sys.stdout is not None:
            sys.stdout.flush()
        if argv is None:  # the process ends: skip the last garbage collection
            gc.freeze()
        return code
    except ArmdError as error:
        print(f"armd: {shorten_lines(error)}", file=sys.stderr)
        return 2
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package in POSIX:
            problem = f"a system without Python's module {package}"
            print(f"armd: {_get_command(argv)}: found {problem}, expected Linux", file=sys.stderr)
            return 2
        if package not in OFFLINE:
            return report_own_fault(error)
        from armd.daemon.missing import suggest_installation

        needs = f"this needs it: {suggest_installation(OFFLINE, package)}"
        print(f"armd: {error.name}: found no such package; {needs}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        drop_output()
        return CUT_OFF
    except OSError as error:
        drop_output()
        print(f"armd: {describe_os_error(error)}", file=sys.stderr)
        return 2
    except MemoryError:
        print("armd: memory: found none left, expected enough for the input", file=sys.stderr)
        return 2
    except SystemExit as end:
        if isinstance(end.__context__, BrokenPipeError):  # rich reports one so
            return CUT_OFF
        raise
    except KeyboardInterrupt:
        return 130
    except Exception as error:
        return report_own_fault(error)


def _get_command(argv: Sequence[str] | None) -> str:
    """Return the command's name as it was called, for a message."""
    words = sys.argv[1:] if argv is None else argv
    return next((word for word in words if word in COMMANDS), "the command")


def name_module(name: str) -> str:
    """Return the module of a command; a Python keyword gets an underscore after it."""
    return f"armd.daemon.commands.{FOLDERS[name]}.{name}{'_' * keyword.iskeyword(name)}"


def _run(arguments: list[str]) -> int:
    for number, argument in enumerate(arguments, 1):
        if any("\ud800" <= letter <= "\udfff" for letter in argument):  # bytes of another encoding
            raise BadInput("command line", f"argument {number}", ascii(argument), "UTF-8 text")
    if arguments[:1] == ["help"]:  # armd help, armd help check
        arguments = [*arguments[1:2], "--help"]
    if arguments[:1] == ["simulate"]:  # a separate program with its own options and help
        from armd.daemon.commands.service import simulate

        simulate.replace_process(arguments[1:])
    chosen = next((word for word in arguments if not word.startswith("-")), None)
    if chosen == "run" and hasattr(
        signal, "SIGHUP"
    ):  # nothing is read yet, so a reload has nothing to do
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
    added = _added(chosen, arguments)
    if chosen is not None and chosen not in COMMANDS and chosen not in added:
        guess = suggest(chosen, [*COMMANDS, *added]) or " (armd --help lists them)"
        raise BadInput("command line", "COMMAND", repr(chosen), f"a command of armd{guess}")
    with collect_seldom() if FOLDERS.get(str(chosen)) == "offline" else nullcontext():
        return _run_chosen(chosen, arguments, added)


def _added(chosen: str | None, arguments: Collection[str]) -> Mapping[str, AddedCommand]:
    """Return commands of other packages: the chosen one, or all for `armd --help`.

    armd's own commands skip the search, which takes time.
    """
    if chosen in COMMANDS or {*arguments} & {"-V", "--version"}:
        return {}
    from armd.daemon.commands.added import load_added_command, load_added_commands

    if chosen is None:
        return load_added_commands(COMMANDS)
    command = load_added_command(chosen, COMMANDS)
    return {} if command is None else {chosen: command}


def _run_chosen(chosen: str | None, arguments: list[str], added: Mapping[str, AddedCommand]) -> int:
    # Only the chosen command's module is imported: `armd check` should not pay for Zenoh.
    with _let_interrupts_end():
        parser, commands = make_parsers([chosen] if chosen else [], added)
    if chosen is None and not {*arguments} & {"-h", "--help", "-V", "--version"}:
        if arguments:
            parser.refuse(arguments)
        parser.print_help(sys.stderr)
        return 2
    namespace, unknown = parser.parse_known_args(arguments)
    assert chosen is not None  # argparse has refused everything else
    if unknown:
        commands[chosen].refuse(unknown)
    with show_log(namespace):
        return _run_command(chosen, namespace, added)


@contextmanager
def _let_interrupts_end() -> Iterator[None]:
    """Let Ctrl-C end the process while packages are imported, unless it is ignored.

    Nothing is written yet, and a package that catches every exception would swallow a
    KeyboardInterrupt.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _run_command(
    chosen: str, namespace: argparse.Namespace, added: Mapping[str, AddedCommand]
) -> int:
    if not namespace.quiet and sys.stderr is not None and sys.stderr.isatty():
        from armd.terminal.aside import report_compiling  # rich takes long to load

        report_compiling()
    if chosen in added:
        return added[chosen].run(namespace)
    return int(importlib.import_module(name_module(chosen)).run(namespace))


def find_installed() -> set[str]:
    """Return the names of the commands whose packages are installed.

    A controller lacks some. Raises `ModuleNotFoundError` for a package that every installation has.
    """
    names = set()
    for name in COMMANDS.keys() - {"simulate"}:  # a program of its own
        try:
            importlib.import_module(name_module(name))
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] not in OFFLINE | POSIX:
                raise
        else:
            names.add(name)
    return names


def make_parsers(
    detailed: Collection[str], added: Mapping[str, AddedCommand] | None = None
) -> tuple[Parser, dict[str, Parser]]:
    """Return the parser of `armd`, and those of its commands and the *added* by name.

    Those in *detailed* have all their options, the others only their line in `armd --help`.
    """
    added = added or {}
    parser = AllCommands(
        prog="armd",
        description="The open driver for articulated measuring arms.",
        epilog="armd COMMAND --help: options, an example, units, exit codes, the page in docs/.\n"
        "Start with: armd demo",
    )
    parser.added = {name: command.help_line for name, command in added.items()}
    parser.add_argument("-V", "--version", action="version", version=f"armd {__version__}")
    commands = parser.add_subparsers(
        dest="command", required=True, metavar="COMMAND", parser_class=Parser
    )
    by_name: dict[str, Parser] = {}
    for name, help_line in (COMMANDS | parser.added).items():
        description = help_line[:1].upper() + help_line[1:] + "."
        by_name[name] = command = commands.add_parser(name, help=help_line, description=description)
        if name in detailed:
            if name in added:
                added[name].add_arguments(command)
            else:
                importlib.import_module(name_module(name)).add_arguments(command)
            if name != "simulate":  # a program of its own
                add_loudness(command)
            if name in USAGE:
                command.formatter_class = argparse.RawDescriptionHelpFormatter
                epilog_text = f"{command.epilog}\n\n" if command.epilog else ""
                command.epilog = epilog_text + USAGE[name].text()
                _exemplify(command, USAGE[name].examples)
    return parser, by_name


class AllCommands(Parser):
    """The parser of `armd` itself, whose help lists the commands in groups."""

    added: Mapping[str, str] = {}
    """Commands of other packages, and what each does."""

    def format_help(self) -> str:
        """Format the help as argparse does, with the commands in groups."""
        options = "  -h, --help     show this help\n  -V, --version  show the version"
        parts = [
            "usage: armd [-h] [-V] COMMAND ...",
            str(self.description),
            format_grouped_help(self.added),
            f"options:\n{options}",
            str(self.epilog),
        ]
        return "\n\n".join(parts) + "\n"


def _exemplify(command: Parser, examples: Sequence[str]) -> None:
    """Give a parser, and those below it, the first example that begins with its name."""
    matching = [example for example in examples if example.startswith(f"{command.prog} ")]
    command.example = matching[0] if matching else ""
    for below in command.subcommands.values():
        _exemplify(below, examples)


if __name__ == "__main__":
    sys.exit(main())
