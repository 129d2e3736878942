"""A command line parser that reports an error in one line, with a suggestion."""

from __future__ import annotations

import argparse
import re
import sys
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

from armd.errors import shorten_lines
from armd.terminal.suggest import suggest

#: argparse's own message for an invalid number.
_NO_NUMBER = re.compile(r"invalid (int|float) value: (.*)")


def _expected_number(match: re.Match[str]) -> str:
    return f"found {match[2]}, expected a {'whole ' * (match[1] == 'int')}number"


class Parser(argparse.ArgumentParser):
    """The parser of a command, or of armd with all its commands."""

    #: shown where an argument is missing
    example = ""
    _words: Sequence[str] = ()
    _subcommands: Mapping[str, Parser] | None = None

    @property
    def arguments(self) -> list[argparse.Action]:
        """Positional arguments and options, in the order in which they were added."""
        return list(self._actions)

    @property
    def subcommands(self) -> Mapping[str, Parser]:
        """The parsers below this one by their names, without those below them."""
        return self._subcommands or {}

    def list_options(self) -> list[str]:
        """List every spelling of every option, including those of the subcommands."""
        below = (option for parser in self.subcommands.values() for option in parser.list_options())
        return [spelling for a in self.arguments for spelling in a.option_strings] + [*below]

    def add_subparsers(self, **options: Any) -> Any:
        """Add subparsers as argparse does; `subcommands` returns those added to them."""
        action = super().add_subparsers(**options)
        self._subcommands = action.choices
        return action

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse as argparse does; the words are kept for `error`."""
        self._words = list(sys.argv[1:] if args is None else args)
        return super().parse_known_args(args, namespace)

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse as argparse does; `refuse` handles unknown words."""
        parsed, unknown = self.parse_known_args(args, namespace)
        if unknown:
            self.refuse(unknown)
        return parsed

    def refuse(self, unknown: Sequence[str]) -> NoReturn:
        """Exit with code 2 for words that are no options of this command or its subcommands."""
        option = next((word for word in unknown if word.startswith("-")), None)
        if option is None:
            self.error(f"found {' '.join(map(repr, unknown))}, expected nothing more")
        name = option.partition("=")[0]
        known_options = self.list_options()
        if name in known_options:  # an option of a command, before the command
            self.error(f"found {name} here, expected the command first")
        self.error(f"found {name}, expected an option{suggest(name, known_options)}")

    def error(self, message: str) -> NoReturn:
        """Exit with a message in one line: argparse would print all options before it."""
        text = _NO_NUMBER.sub(_expected_number, " ".join(message.split()))
        text = shorten_lines(text)
        if "required" in text:  # a misspelt option is not missing
            known_options = self.list_options()
            names = [word.partition("=")[0] for word in self._words if word.startswith("--")]
            strange = [
                name
                for name in names
                if not any(option.startswith(name) for option in known_options)
            ]
            if strange:
                self.refuse(strange)
        advice = f"{self.prog} --help"
        if "required" in text and self.example:
            text, advice = f"{text}, as in: {self.example}", f"more: {advice}"
        print(f"armd: command line: {self.prog}: {text} ({advice})", file=sys.stderr)
        sys.exit(2)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Check an argument with a list of choices."""
        if action.choices is not None and value not in action.choices:
            choices = [str(choice) for choice in action.choices]
            raise argparse.ArgumentError(
                action,
                f"found {value!r}, expected one of {', '.join(choices)}"
                f"{suggest(str(value), choices)}",
            )


#: The exit codes of every command, unless its own entry has more.
CODES = {
    0: "done",
    2: "bad usage or bad input: one line on standard error says what and where (-v: more)",
    70: "a fault of armd itself: please report what it printed",
}


@dataclass(frozen=True)
class Usage:
    """The further help of one command."""

    examples: tuple[str, ...]
    page: str
    """In docs/."""
    units: str = ""
    no: str = ""
    """When the exit code is 1: the work ran, and the answer is no."""

    def text(self) -> str:
        """Return the text below the options."""
        codes = {0: CODES[0]} | ({1: self.no} if self.no else {}) | {2: CODES[2], 70: CODES[70]}
        blocks = {
            "example" if len(self.examples) == 1 else "examples": self.examples,
            "units": (self.units,) if self.units else (),
            "exit code": tuple(f"{number}  {words}" for number, words in codes.items()),
            "more": (f"docs/{self.page}",),
        }
        return "\n\n".join(
            f"{title}:\n{textwrap.indent(chr(10).join(lines), '  ')}"
            for title, lines in blocks.items()
            if lines
        )
