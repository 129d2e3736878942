"""`armd man`: print the help of all commands as one man page, in roff."""

from __future__ import annotations

import argparse

from armd import __version__


def add_arguments(parser: argparse.ArgumentParser) -> None:
    pass


def run(args: argparse.Namespace) -> int:
    print(make_page())
    return 0


def make_page() -> str:
    """Return the texts of `armd --help` and `armd COMMAND --help` in roff."""
    from armd.daemon.cli import find_installed, make_parsers

    names = find_installed()
    parser, commands = make_parsers(names)
    parts = [
        f'.TH ARMD 1 "" "armd {__version__}" "User commands"',
        f".SH NAME\narmd \\- {_escape_text(str(parser.description))}",
        ".SH SYNOPSIS\n.B armd\n.I COMMAND\n[options]",
        f".SH DESCRIPTION\n{_escape_text(str(parser.epilog))}",
        ".SH COMMANDS",
    ]
    for name, command in commands.items():
        parts.append(f".SS armd {name}\n{_escape_text(str(command.description))}")
        if name == "simulate":  # a separate program
            parts.append("See armd simulate \\-\\-help.")
            continue
        if name not in names:
            parts.append(
                "Needs packages that are not installed here; it says which when it is run."
            )
            continue
        # The description is above already; usage, options and examples follow unchanged.
        command.description = None
        parts.append(f".PP\n.nf\n{_escape_text(command.format_help())}\n.fi")
    return "\n".join(parts)


def _escape_text(text: str) -> str:
    """Escape text so that roff shows it unchanged."""
    lines = text.strip().replace("\\", "\\e").replace("-", "\\-").splitlines()
    return "\n".join("\\&" + line if line[:1] in (".", "'") else line for line in lines)
