"""`armd completion SHELL`: what a shell needs to complete commands and options, as a script."""

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
    """Made of the commands' own parsers; every value without a list of its own is a file."""
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
            # A list, as shtab takes a dictionary for subcommands; without `"`, which is an inch and
            # which it does not quote.
            action.choices = [choice for choice in action.choices if choice != '"']
        elif action.nargs != 0:
            action.complete = files  # type: ignore[attr-defined]
