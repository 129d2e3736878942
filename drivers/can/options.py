"""Which keys of `[driver]` python-can knows: it swallows any other without a word."""

from __future__ import annotations

import inspect
import logging
import re
from dataclasses import dataclass
from importlib import import_module

from can.interfaces import BACKENDS
from can.typechecking import BitTimingDict, BitTimingFdDict

logging.getLogger("can").addHandler(logging.NullHandler())  # makers' libraries that are not there

#: What `can.Bus` itself makes something of, or any interface may be given.
COMMON = {"bitrate", "data_bitrate", "fd", "receive_own_messages"} | {
    *BitTimingDict.__annotations__,
    *BitTimingFdDict.__annotations__,
}
_TAKEN = re.compile(r"""kwargs(?:\.get|\.pop)?[(\[]["'](\w+)["']""")
INTERFACES = tuple(sorted(BACKENDS))


@dataclass(frozen=True, slots=True)
class InterfaceKeys:
    """The keys of one interface, `channel` among them where it is one."""

    known: frozenset[str]
    required: frozenset[str]


def options_of(interface: str) -> InterfaceKeys | None:
    """None for an interface whose library is not installed here: nobody knows its keys then.

    An interface takes what its constructors name, and what they fetch from their `**kwargs`.
    """
    module, name = BACKENDS[interface]
    try:
        bus = getattr(import_module(module), name)
        source = inspect.getsource(bus)
    except Exception:  # a maker's library that is missing shows itself in any way it likes
        return None
    known = COMMON | set(_TAKEN.findall(source))
    required: set[str] = set()
    for kind in (kind for kind in bus.__mro__ if "__init__" in vars(kind)):
        for parameter in inspect.signature(kind.__init__).parameters.values():
            if parameter.kind in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL):
                continue
            known.add(parameter.name)
            if kind is bus and parameter.default is parameter.empty:
                required.add(parameter.name)
    return InterfaceKeys(frozenset(known - {"self"}), frozenset(required - {"self"}))
