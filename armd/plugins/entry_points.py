"""Entry points of other packages: `armd.drivers`, `armd.commands`, `armd.causes`.

docs/developer/plugins.md describes them. They are searched only for a name that armd itself does
not have, or for a list of all names: reading the metadata of all packages takes some ten
milliseconds. A plug-in that does not load, or does not fit its group, is reported once on standard
error and skipped.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal, TypeVar

from armd.errors import BadInput
from armd.printable import to_printable

Group = Literal["armd.drivers", "armd.commands", "armd.causes"]
T = TypeVar("T")


@dataclass(frozen=True)
class Plugin:
    """One entry point of another package."""

    group: Group
    name: str
    package: str
    """Name and version of the distribution that brings it."""
    entry: EntryPoint

    def fault(self, problem: str, expected: str) -> BadInput:
        """Return an error that names the package and the entry point."""
        return BadInput(f"package {self.package}", f"{self.group} {self.name}", problem, expected)

    def fault_of(self, error: BaseException, expected: str) -> BadInput:
        """Return such an error for an exception of the package's code."""
        message = " ".join(str(error).split())
        return self.fault(
            f"{type(error).__name__}: {message}" if message else repr(error), expected
        )


def load_named(
    group: Group, name: str, built_in: Collection[str], check: Callable[[Plugin, Any], T]
) -> T | None:
    """Load the plug-in *name*; None if no package provides one that works.

    *check* returns the used part of a loaded object, or raises an error of `Plugin.fault`.
    """
    plugin = {plugin.name: plugin for plugin in _plugins(group, built_in)}.get(name)
    return None if plugin is None else _loaded(plugin, check)


def load_all(
    group: Group, built_in: Collection[str], check: Callable[[Plugin, Any], T]
) -> dict[str, T]:
    """Load all plug-ins of a group that work, by name."""
    loaded = ((plugin.name, _loaded(plugin, check)) for plugin in _plugins(group, built_in))
    return {name: value for name, value in loaded if value is not None}


@cache
def report(text: str) -> None:
    """Report a fault of a plug-in on standard error; each text once in a process."""
    if sys.stderr is not None:
        print(to_printable(f"armd: {text}; skipped"), file=sys.stderr, flush=True)


def _plugins(group: Group, built_in: Collection[str]) -> Iterator[Plugin]:
    """Yield the plug-ins in the order of their names; a duplicate name is reported."""
    owner_of_name = dict.fromkeys(built_in, "armd itself")
    for entry in sorted(entry_points(group=group), key=lambda entry: (entry.name, entry.value)):
        package = "unknown" if entry.dist is None else f"{entry.dist.name} {entry.dist.version}"
        plugin = Plugin(group, entry.name, package, entry)
        if entry.name in owner_of_name:
            problem = f"a name that {owner_of_name[entry.name]} has"
            report(str(plugin.fault(problem, "a name of its own")))
            continue
        owner_of_name[entry.name] = f"package {package}"
        yield plugin


def _loaded(plugin: Plugin, check: Callable[[Plugin, Any], T]) -> T | None:
    try:
        loaded = plugin.entry.load()
    except (Exception, SystemExit) as error:
        report(str(plugin.fault_of(error, f"that {plugin.entry.value} can be imported")))
        return None
    try:
        return check(plugin, loaded)
    except BadInput as error:
        report(str(error))
        return None
