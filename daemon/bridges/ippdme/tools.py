"""Tools: RefTool (the calibration's own tip), NoTool, and the tips of armd.toml, with aliases.

A manual arm does not drive, but hosts read and set speeds and distances all the same. So every tool
has them: Min ≤ Act ≤ Max, and Def is the initial value of Act.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from armd.daemon.bridges.ippdme.errors import DmeError
from armd.daemon.bridges.tips import CmmTip, Tips

REF_TOOL, NO_TOOL, UNDEF_TOOL, BASE_TOOL = "RefTool", "NoTool", "UnDefTool", "BaseTool"
RESERVED = (REF_TOOL, NO_TOOL, UNDEF_TOOL, BASE_TOOL)

#: block → property → (Min, Max, Def); mm/s, mm/s², mm
LIMITS: dict[str, dict[str, tuple[float, float, float]]] = {
    "GoToPar": {"Speed": (0.1, 1000.0, 100.0), "Accel": (0.1, 10000.0, 1000.0)},
    "PtMeasPar": {
        "Speed": (0.1, 1000.0, 10.0),
        "Accel": (0.1, 10000.0, 1000.0),
        "Approach": (0.0, 1000.0, 10.0),
        "Search": (0.0, 1000.0, 10.0),
        "Retract": (0.0, 1000.0, 10.0),
    },
    "ScanPar": {
        "Speed": (0.1, 1000.0, 10.0),
        "Accel": (0.1, 10000.0, 1000.0),
        "Retract": (0.0, 1000.0, 10.0),
    },
}
PARTS = ("Act", "Def", "Max", "Min")


@dataclass
class Tool:
    """One tool, with the name that the host uses."""

    name: str
    tip_name: str | None
    """Of armd.toml; None: the calibration's own."""
    tip: CmmTip | None
    """None: it cannot measure."""
    actual: dict[str, float] = field(default_factory=dict)
    """What the host has set, by `PtMeasPar.Speed`."""

    @property
    def measures(self) -> bool:
        return self.tip is not None

    @property
    def radius_mm(self) -> float:
        return 0.0 if self.tip is None else self.tip.radius_mm

    def number(self, name: str) -> float:
        """Return `PtMeasPar.Speed` or `PtMeasPar.Speed.Max`; raises `DmeError`."""
        key, part = self._find(name)
        low, high, default = _limits(key)
        if part == "Act":
            return self.actual.get(key, default)
        return {"Min": low, "Max": high, "Def": default}[part]

    def set_number(self, name: str, value: float) -> bool:
        """Set a number, clamped to its limits; return whether *value* was within them.

        Raises `DmeError` for an unknown name.
        """
        key, part = self._find(name)
        if part != "Act":
            raise DmeError(510)
        low, high, _ = _limits(key)
        self.actual[key] = min(max(value, low), high)
        return low <= value <= high

    def _find(self, name: str) -> tuple[str, str]:
        """Split a name into `PtMeasPar.Speed` and `Act`; raises `DmeError`."""
        if not self.measures:
            raise DmeError(507)
        words = name.split(".")
        key, part = ".".join(words[:2]), words[2] if len(words) == 3 else "Act"
        if not 2 <= len(words) <= 3 or part not in PARTS:
            raise DmeError(510)
        _limits(key)
        return key, part


def _limits(key: str) -> tuple[float, float, float]:
    block, _, name = key.partition(".")
    try:
        return LIMITS[block][name]
    except KeyError as error:
        raise DmeError(510) from error


def list_tool_properties(block: str) -> Iterator[tuple[str, str]]:
    """Yield the names below a block, dotted, with their types.

    The block is `Tool` (block "") or `Tool.PtMeasPar` (block "PtMeasPar"). Names without a dot are
    the block's own. Raises `DmeError` for an unknown block.
    """
    if block == "":
        yield from (("Name", "String"), ("Id", "String"), ("AvrRadius", "Number"))
        yield ("Alignment", "Number")
        for name in LIMITS:
            yield name, "Property"
            yield from ((f"{name}.{below}", kind) for below, kind in list_tool_properties(name))
        return
    head, _, name = block.partition(".")
    if head not in LIMITS or (name and name not in LIMITS[head]):
        raise DmeError(510)
    for below in [name] if name else LIMITS[head]:
        prefix = "" if name else f"{below}."
        if not name:
            yield below, "Number"
        yield from ((prefix + part, "Number") for part in PARTS)


class Toolbox:
    """All tools and the one in use, which both host and operator change."""

    def __init__(self, tips: Tips, aliases: Mapping[str, str], tip_name: str | None) -> None:
        """Collect the tools; *tip_name* is the tip in use.

        *aliases* maps the host's name to a tip's name, or to RefTool.
        """
        self._by_name: dict[str, Tool] = {}
        self._add(REF_TOOL, None, tips.get(None))
        self._add(NO_TOOL, None, None)
        for name in tips.names:
            if name not in RESERVED:
                self._add(name, name, tips.get(name))
        for alias, aliased in aliases.items():
            alias_tip = None if aliased == REF_TOOL else aliased
            self._add(alias, alias_tip, tips.get(alias_tip))
        self._aliases = list(aliases)
        self.undefined = Tool(UNDEF_TOOL, None, None)
        self.selected = self.undefined
        self.current = self._by_tip(tip_name)

    def _add(self, name: str, tip_name: str | None, tip: CmmTip | None) -> None:
        self._by_name[name] = Tool(name, tip_name, tip)

    @property
    def names(self) -> list[str]:
        return list(self._by_name)

    def get(self, name: str) -> Tool:
        """Return the tool of a name; raises `DmeError` for an unknown or unusable one."""
        if name == UNDEF_TOOL:
            raise DmeError(1503)
        if name not in self._by_name:
            raise DmeError(1502)
        return self._by_name[name]

    def renew(self, tip_name: str | None, tip: CmmTip) -> None:
        """Replace the data of a tip, or add a new tip."""
        for tool in self._by_name.values():
            if tool.measures and tool.tip_name == tip_name:
                tool.tip = tip
        if tip_name is not None and tip_name not in self._by_name:
            self._add(tip_name, tip_name, tip)

    def use(self, tool: Tool) -> None:
        self.current = tool

    def note_tip(self, tip_name: str | None) -> Tool | None:
        """Note the tip that the arm uses now; return its tool if it has changed."""
        if self.current.measures and self.current.tip_name == tip_name:
            return None
        self.current = self._by_tip(tip_name)
        return self.current

    def _by_tip(self, tip_name: str | None) -> Tool:
        """Return the tool of a tip, by its alias if it has one: the host knows that name."""
        names = [*self._aliases, *self._by_name]
        tools = (self._by_name[name] for name in names)
        matching = (tool for tool in tools if tool.measures and tool.tip_name == tip_name)
        return next(matching, self._by_name[REF_TOOL])
