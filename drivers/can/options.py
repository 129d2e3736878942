"""The keys of `[driver]` that python-can knows, and their permitted values.

python-can ignores unknown keys without a message.
"""

from __future__ import annotations

import inspect
import logging
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any, get_args, get_type_hints

from can.interfaces import BACKENDS
from can.typechecking import BitTimingDict, BitTimingFdDict

logging.getLogger("can").addHandler(logging.NullHandler())  # no messages of missing libraries

#: Keys that `can.Bus` itself uses, or that any interface accepts.
COMMON: dict[str, type] = {
    "bitrate": int,
    "data_bitrate": int,
    "fd": bool,
    "receive_own_messages": bool,
    **dict.fromkeys((*BitTimingDict.__annotations__, *BitTimingFdDict.__annotations__), int),
}
#: Types of keys that python-can does not annotate.
_KINDS: dict[str, type] = {**COMMON, "host": str, "port": int, "btr": str}
#: Permitted ranges: CiA 301's rates, the rates of CAN FD transceivers, a socket's ports, a UART's
#: rates, and the longest reasonable wait in seconds.
_UART, _SECONDS = (9_600, 12_000_000), (0, 60)
_RANGES = {
    "bitrate": (10_000, 1_000_000),
    "data_bitrate": (10_000, 8_000_000),
    "port": (1, 65_535),
    "hop_limit": (0, 255),
    **dict.fromkeys(("baudrate", "tty_baudrate", "ttyBaudrate"), _UART),
    **dict.fromkeys(("sleep_after_open", "timeout", "poll_interval"), _SECONDS),
}
_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}
_TAKEN = re.compile(r"""kwargs(?:\.get|\.pop)?[(\[]["'](\w+)["']""")
INTERFACES = tuple(sorted(BACKENDS))


@dataclass(frozen=True, slots=True)
class InterfaceKeys:
    """The keys of one interface, including `channel` where it is one."""

    names: frozenset[str]
    required: frozenset[str]
    kinds: Mapping[str, type]  # types of values, where known: bool, int, float or str

    def expected(self, key: str, value: object) -> str:
        """Return a description of permitted values; empty if *value* is permitted."""
        kind = self.kinds.get(key)
        low, high = _RANGES.get(key, (0, math.inf))
        if kind is None:
            number = isinstance(value, int | float)
            return "" if not number or _is_within(value, low, high) else "a number of 0 or more"
        if kind is bool:
            fits = isinstance(value, bool)
        elif kind is str:
            fits = isinstance(value, str) and bool(value.strip()) and value.isprintable()
        else:
            numbers = int if kind is int else int | float
            number = isinstance(value, numbers) and not isinstance(value, bool)
            fits = number and _is_within(value, low, high)
        if fits:
            return ""
        return _WORDS[kind] + (f", {low} to {high}" if math.isfinite(high) else _at_least(kind))


def _is_within(value: Any, low: float, high: float) -> bool:
    return math.isfinite(value) and low <= value <= high


def _at_least(kind: type) -> str:
    return " of 0 or more" if kind in (int, float) else ""


def find_options(interface: str) -> InterfaceKeys | None:
    """Find the keys of *interface*; None if its library is not installed here.

    The keys are the parameters of its constructors, and the names that they take from their
    `**kwargs`.
    """
    module, name = BACKENDS[interface]
    try:
        bus = getattr(import_module(module), name)
        source = inspect.getsource(bus)
    except Exception:  # a missing library may raise any exception
        return None
    kinds: dict[str, type] = {}
    names = set(COMMON) | set(_TAKEN.findall(source))
    required: set[str] = set()
    for base in (base for base in bus.__mro__ if "__init__" in vars(base)):
        hints = get_type_hints(base.__init__)
        for parameter in inspect.signature(base.__init__).parameters.values():
            if parameter.kind in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL):
                continue
            names.add(parameter.name)
            kind = _kind_of(hints.get(parameter.name), parameter.default)
            if kind is not None:
                kinds.setdefault(parameter.name, kind)
            if base is bus and parameter.default in (parameter.empty, ""):
                required.add(parameter.name)
    names.discard("self")
    required.discard("self")
    return InterfaceKeys(frozenset(names), frozenset(required), {**_KINDS, **kinds})


def _kind_of(hint: Any, default: object) -> type | None:
    """Return the type of a parameter, from its annotation (T, or T | None), or else its default."""
    types = [part for part in get_args(hint) or (hint,) if part is not type(None)]
    if len(types) == 1 and types[0] in _WORDS:
        kind: type = types[0]
        return kind
    return type(default) if hint is None and type(default) in _WORDS else None
