"""Arguments of several commands: the arm, and numbers; invalid ones are refused at once."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable

import armd


def add_arm(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of an arm: its serial number, and its daemon's endpoint."""
    parser.add_argument("serial", nargs="?", help="serial number (the one arm that is there)")
    add_endpoint(parser)


def add_endpoint(parser: argparse.ArgumentParser) -> None:
    """Add the option of a daemon's endpoint."""
    parser.add_argument("--endpoint", default=armd.ENDPOINT, help=f"({armd.ENDPOINT})")


def parse_seconds(text: str) -> float:
    """Parse a duration in seconds, above 0."""
    return _number(text, lambda value: value > 0, "a number of seconds above 0")


def parse_finite(text: str) -> float:
    """Parse a number of either sign."""
    return _number(text, lambda value: True, "a number")


def parse_positive(text: str) -> float:
    """Parse a length or another number above 0."""
    return _number(text, lambda value: value > 0, "a number above 0")


def parse_factor(text: str) -> float:
    """Parse a factor: a number of 0 or more."""
    return _number(text, lambda value: value >= 0, "a number of 0 or more")


def parse_seed(text: str) -> int:
    """Parse a seed of random numbers."""
    return parse_integer(text, 0, 2**63 - 1)


def parse_integer(text: str, minimum: int, maximum: int) -> int:
    """Parse an integer of *minimum* to *maximum*."""
    expected = f"a whole number, {minimum} to {maximum}"
    try:
        value = int(text)
    except ValueError as error:
        raise _wrong(text, expected) from error
    if not minimum <= value <= maximum:
        raise _wrong(text, expected)
    return value


def _number(text: str, fits: Callable[[float], bool], expected: str) -> float:
    try:
        value = float(text)
    except ValueError as error:
        raise _wrong(text, expected) from error
    if not (math.isfinite(value) and fits(value)):
        raise _wrong(text, expected)
    return value


def _wrong(text: str, expected: str) -> argparse.ArgumentTypeError:
    excerpt = text if len(text) <= 40 else text[:37] + "..."
    return argparse.ArgumentTypeError(f"found {excerpt!r}, expected {expected}")
