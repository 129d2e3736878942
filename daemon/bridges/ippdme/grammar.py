"""The standard's grammar (1.4.3, 6.1.4), read and written.

    Number := [+-] (digits [.] [digits] | .digits) [(E|e) [+-] d[d[d]]]   with ≤ 16 digits
    Arg    := String | Number | Property | ETag | Basic;   Method := Basic([Arg{, Arg}])
    Name   := Basic{.Basic};   Property := Name([Arg{, Arg}])

The digits of an exponent do not count (NIST's numbersCmdOK.prg: `+1.234567890123456E003`). A number
that a double cannot hold (`1E400`) is none: infinity would pass every comparison with a limit.
Any number of spaces before and after `,` and `(` and before `)`; none after `)`.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TypeVar

from armd.daemon.bridges.ippdme.errors import DmeError

#: Characters of a line; CR and LF end it.
LONGEST = 65536
TAG = re.compile(r"(?!00000)\d{5}|E(?!0000)\d{4}")
EVENT_TAG = re.compile(r"E\d{4}")
_ILLEGAL = re.compile(r"[^ -~]")
_METHOD = re.compile(r"([A-Za-z][A-Za-z0-9]*) *(.*)", re.DOTALL)
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(?:[Ee][+-]?\d{1,3})?", re.ASCII)
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*(?:\.[A-Za-z][A-Za-z0-9]*)*")
_STRING = re.compile(r'"([^"]+)"')
_COMMA = re.compile(r" *, *")
_OPEN = re.compile(r" *\( *")
_CLOSE = re.compile(r" *\)")
DIGITS = 16


@dataclass(frozen=True)
class Text:
    """A string between quotation marks."""

    value: str


@dataclass(frozen=True)
class Word:
    """A bare word: an enumeration's value, or an event tag."""

    value: str


@dataclass(frozen=True)
class Property:
    """A property such as `X()`, `X(1.5)`, `Tool.PtMeasPar.Speed(20)`."""

    name: str
    values: tuple[Arg, ...] = ()


Arg = float | Text | Word | Property
Kind = TypeVar("Kind", Text, Word)


@dataclass(frozen=True)
class Command:
    """A line of the client's."""

    tag: str
    method: str
    args: tuple[Arg, ...]


class SyntaxFault(Exception):
    """A line that does not follow the grammar.

    `tag` is None where the line has no legal tag. `method` is the method's name if it could be
    read, else the line itself in a form that a string can hold.
    """

    def __init__(self, number: int, tag: str | None, method: str) -> None:
        super().__init__(number)
        self.number = number
        self.tag = tag
        self.method = method


def parse(line: str) -> Command:
    """Parse a line without its CR LF; raises `SyntaxFault`."""
    tag = line[:5] if TAG.fullmatch(line[:5]) else None
    if _ILLEGAL.search(line):
        raise SyntaxFault(7, tag, _as_string(line))
    if tag is None:
        raise SyntaxFault(1, None, _as_string(line))
    if line[5:6] != " ":
        raise SyntaxFault(2, tag, _as_string(line))
    match = _METHOD.match(line, 6)
    if match is None:
        raise SyntaxFault(8, tag, _as_string(line))
    method = match[1]
    reader = _Reader(line, 6 + len(method))
    try:
        args = reader.arguments()
        reader.end()
    except ValueError as error:
        raise SyntaxFault(502, tag, method) from error
    return Command(tag, method, args)


def parse_number(text: str) -> float | None:
    """Return a number's value, always finite; None if the grammar does not allow it."""
    match = _NUMBER.fullmatch(text)
    if match is None or len(match[1].replace(".", "")) > DIGITS:
        return None
    value = float(text)
    return value if math.isfinite(value) else None


class _Reader:
    """Reads arguments of a line from an offset on."""

    def __init__(self, text: str, start: int, in_property: bool = False) -> None:
        self._text = text
        self._offset = start
        self._in_property = in_property

    def arguments(self) -> tuple[Arg, ...]:
        """Read `( … )`; raises ValueError."""
        self._take(_OPEN)
        if self._try(_CLOSE):
            return ()
        args = [self._argument()]
        while not self._try(_CLOSE):
            self._take(_COMMA)
            args.append(self._argument())
        return tuple(args)

    def end(self) -> None:
        if self._offset != len(self._text):
            raise ValueError("more after the closing parenthesis")

    def _argument(self) -> Arg:
        if (string := self._try(_STRING)) is not None:
            return Text(string[1])
        if (written := self._try(_NUMBER)) is not None:
            value = parse_number(written[0])
            if value is None:
                raise ValueError("too many digits, or too large")
            return value
        name = self._take(_NAME)[0]
        if _OPEN.match(self._text, self._offset):
            # The grammar has no property within a property, so this limits the depth.
            if self._in_property:
                raise ValueError("a property within a property")
            inner = _Reader(self._text, self._offset, in_property=True)
            values = inner.arguments()
            self._offset = inner._offset
            return Property(name, values)
        if "." in name:
            raise ValueError("a property without parentheses")
        return Word(name)

    def _try(self, pattern: re.Pattern[str]) -> re.Match[str] | None:
        match = pattern.match(self._text, self._offset)
        if match is not None:
            self._offset = match.end()
        return match

    def _take(self, pattern: re.Pattern[str]) -> re.Match[str]:
        match = self._try(pattern)
        if match is None:
            raise ValueError(f"unexpected at {self._offset}")
        return match


# --- writing: the form that strict parsers and simple hosts both read ------------------------


def format_decimal(value: float, places: int = 5) -> str:
    """Format in fixed point, with at most 16 digits and never −0.

    A number that needs more digits has an exponent.
    """
    if abs(value) >= 10**DIGITS:
        return f"{value:.{DIGITS - 1}e}"
    text = f"{value:.{places}f}"
    if text.startswith("-") and not float(text):
        text = text[1:]
    digits = sum(letter.isdigit() for letter in text)
    return text if digits <= DIGITS else f"{value:.{max(places - (digits - DIGITS), 0)}f}"


def format_quoted(text: str) -> str:
    """Return the text between quotation marks."""
    return f'"{_as_string(text)}"'


def format_list(parts: dict[str, str]) -> str:
    """Return `X(1.00000), Y(2.00000)`; each part's arguments are already formatted."""
    return ", ".join(f"{name}({written})" for name, written in parts.items())


def _as_string(text: str) -> str:
    """Return the text that a string of the grammar can hold: at least one character."""
    legal = _ILLEGAL.sub("?", text.replace('"', "#"))
    return legal[:200] or " "


def require_nothing(args: tuple[Arg, ...]) -> None:
    """Check that there are no arguments; raises `DmeError`."""
    if args:
        raise DmeError(502)


def require_text(args: tuple[Arg, ...]) -> str:
    """Return the only argument, a string; raises `DmeError`."""
    return _take_single(args, Text).value


def require_word(args: tuple[Arg, ...]) -> str:
    """Return the only argument, a bare word; raises `DmeError`."""
    return _take_single(args, Word).value


def _take_single(args: tuple[Arg, ...], kind: type[Kind]) -> Kind:
    if len(args) != 1:
        raise DmeError(502)
    if not isinstance(args[0], kind):
        raise DmeError(509)
    return args[0]
