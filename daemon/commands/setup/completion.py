"""`armd completion SHELL`: print a script that completes commands and options in a shell."""

from __future__ import annotations

import argparse

from armd.terminal.parser import Parser

SHELLS = ("bash", "zsh", "fish")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=SHELLS)


def run(args: argparse.Namespace) -> int:
    print(make_script(args.shell))
    return 0


def make_script(shell: str) -> str:
    """Return the script, made from the commands' parsers.

    Every value without a list of choices is completed as a file.
    """
    import shtab  # only here

    from armd.daemon.cli import find_installed, make_parsers

    parser, commands = make_parsers(find_installed())
    for command in commands.values():
        _complete_files(command, shtab.FILE)
    return str(shtab.complete(parser, shell))


def _complete_files(parser: Parser, files: object) -> None:
    for below in parser.subcommands.values():
        _complete_files(below, files)
    for action in parser.arguments:
        if action.choices is parser.subcommands:
            continue
        if action.choices:
            # A list, because shtab takes a dictionary for subcommands. Without `"` (inch), because
            # shtab does not quote it.
            action.choices = [choice for choice in action.choices if choice != '"']
        elif action.nargs != 0:
            action.complete = files  # type: ignore[attr-defined]
