"""Commands of other packages: entry points `armd.commands` (docs/developer/plugins.md)."""

from __future__ import annotations

import argparse
from collections.abc import Collection
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from armd.plugins.entry_points import Group, Plugin, load_all, load_named
from armd.terminal.loudness import ANSWERED, report_own_fault

GROUP: Group = "armd.commands"


@dataclass(frozen=True)
class AddedCommand:
    """A module of another package with `HELP`, `add_arguments` and `run`, like armd's own."""

    plugin: Plugin
    module: ModuleType

    @property
    def help_line(self) -> str:
        """The command's line in `armd --help`."""
        return f"{self.module.HELP} ({self.plugin.package})"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the command's options; raises `BadInput` where the package's code fails."""
        try:
            self.module.add_arguments(parser)
        except Exception as error:
            raise self.plugin.fault_of(error, "that add_arguments takes a parser") from error

    def run(self, args: argparse.Namespace) -> int:
        """Run the command and return its exit code.

        An unexpected exception gives 70, as for armd's own commands.
        """
        try:
            return int(self.module.run(args) or 0)
        except ANSWERED:
            raise
        except Exception as error:
            return report_own_fault(error, f"package {self.plugin.package}")


def load_added_command(name: str, built_in: Collection[str]) -> AddedCommand | None:
    """Return the command *name* of a package; None without one that works."""
    return load_named(GROUP, name, built_in, _check_command)


def load_added_commands(built_in: Collection[str]) -> dict[str, AddedCommand]:
    """Return all commands of other packages, by name."""
    return load_all(GROUP, built_in, _check_command)


def _check_command(plugin: Plugin, loaded: Any) -> AddedCommand:
    expected = "a module with HELP (one line), add_arguments(parser) and run(args)"
    if not isinstance(getattr(loaded, "HELP", None), str):
        raise plugin.fault(f"no HELP in {loaded!r}", expected)
    for name in ("add_arguments", "run"):
        if not callable(getattr(loaded, name, None)):
            raise plugin.fault(f"no {name} in {loaded!r}", expected)
    return AddedCommand(plugin, loaded)
