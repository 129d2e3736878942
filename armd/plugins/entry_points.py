"""What other packages say of themselves: entry points `armd.drivers`, `armd.commands`,
`armd.causes` (docs/developer/plugins.md).

Nothing is looked for until a name is asked for that armd itself has not, or until all are listed:
to read the metadata of all packages takes some ten milliseconds. A plug-in that does not load, or
is not what its group wants, is reported once on standard error and skipped.
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
        """An error that names the package and the entry point."""
        return BadInput(f"package {self.package}", f"{self.group} {self.name}", problem, expected)

    def fault_of(self, error: BaseException, expected: str) -> BadInput:
        """The same of what its code raised."""
        message = " ".join(str(error).split())
        return self.fault(
            f"{type(error).__name__}: {message}" if message else repr(error), expected
        )


def load_named(
    group: Group, name: str, built_in: Collection[str], check: Callable[[Plugin, Any], T]
) -> T | None:
    """The plug-in *name*, or None if no package brings one that works.

    *check* returns what is used of a loaded object, or raises an error of `Plugin.fault`.
    """
    plugin = {plugin.name: plugin for plugin in _plugins(group, built_in)}.get(name)
    return None if plugin is None else _loaded(plugin, check)


def load_all(
    group: Group, built_in: Collection[str], check: Callable[[Plugin, Any], T]
) -> dict[str, T]:
    """All plug-ins of a group that work, by name."""
    loaded = ((plugin.name, _loaded(plugin, check)) for plugin in _plugins(group, built_in))
    return {name: value for name, value in loaded if value is not None}


@cache
def report(text: str) -> None:
    """Say on standard error what is wrong with a plug-in; each text once in a process."""
    if sys.stderr is not None:
        print(to_printable(f"armd: {text}; skipped"), file=sys.stderr, flush=True)


def _plugins(group: Group, built_in: Collection[str]) -> Iterator[Plugin]:
    """In the order of their names; a name that is taken is reported."""
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
