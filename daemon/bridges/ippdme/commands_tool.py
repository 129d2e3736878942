"""The methods about tools and their properties."""

from __future__ import annotations

from armd.daemon.bridges.ippdme.dialogue import Answer, Dialogue, Pending, is_2_5
from armd.daemon.bridges.ippdme.errors import DmeError
from armd.daemon.bridges.ippdme.grammar import (
    Arg,
    Command,
    Property,
    format_decimal,
    format_list,
    format_quoted,
    require_nothing,
    require_text,
)
from armd.daemon.bridges.ippdme.report import format_fields
from armd.daemon.bridges.ippdme.tools import Tool, list_tool_properties


def list_tools(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    names = dialogue.machine.toolbox.names
    return [_bare(name) if is_2_5(dialogue) else format_quoted(name) for name in names]


def find_tool(dialogue: Dialogue, command: Command) -> Answer:
    toolbox = dialogue.machine.toolbox
    toolbox.selected = toolbox.undefined
    toolbox.selected = toolbox.get(require_text(command.args))
    return ()


def set_tool(dialogue: Dialogue, command: Command) -> Answer:
    """Use a tool; ask the daemon for its tip if another tip is in use."""
    machine = dialogue.machine
    tool = machine.toolbox.get(require_text(command.args))
    dialogue.user_enabled = False
    if not tool.measures or (
        machine.toolbox.current.measures and tool.tip_name == machine.toolbox.current.tip_name
    ):
        machine.toolbox.use(tool)
        dialogue.report_now()
        return ()
    before = machine.toolbox.current
    machine.toolbox.use(tool)  # at once, so that the arm's own event reports no change
    pending = Pending()

    def settle(done: bool) -> None:
        if done:
            dialogue.report_now()
            pending.settle([])
        else:
            if machine.toolbox.current is tool:
                machine.toolbox.use(before)
            pending.settle(DmeError(511))

    machine.select_tip(tool.tip_name or "", settle)
    return pending


def get_change_tool_action(dialogue: Dialogue, command: Command) -> Answer:
    """Answer that a person changes the tool wherever the arm is."""
    toolbox = dialogue.machine.toolbox
    tool = toolbox.get(require_text(command.args))
    if tool is toolbox.current:
        return ["ChangeToolAction(Switch)"]
    x, y, z = dialogue.machine.position().tolist()
    place = format_list(format_fields(("X", "Y", "Z"), {"X": (x,), "Y": (y,), "Z": (z,)}))
    return [f"ChangeToolAction(MoveMan, {place})"]


def refuse_qualification(dialogue: Dialogue, command: Command) -> Answer:
    """Answer with an error: a tool cannot be qualified from here.

    An answer without an error would mean that the tool is qualified again (6.3.2). armd does that
    with `armd measure tip` and a calibration.
    """
    require_nothing(command.args)
    if not dialogue.machine.toolbox.current.measures:
        raise DmeError(507)
    raise DmeError(501)


# --- 2.5: which tool, and collections of them ------------------------------------------------

#: The only collection, below the root: it holds every tool by its own name.
COLLECTION = "Tools"


def get_current_tool(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    return [_bare(dialogue.machine.toolbox.current.name)]


def get_selected_tool(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    return [_bare(dialogue.machine.toolbox.selected.name)]


def is_alignable(dialogue: Dialogue, command: Command) -> Answer:
    """Answer no: a person turns the probe, the host cannot."""
    require_nothing(command.args)
    return ["IsAlignable(0)"]


def list_tool_collection(dialogue: Dialogue, command: Command) -> Answer:
    if _collection(command.args):
        return [f'{format_quoted(name)}, "Tool"' for name in dialogue.machine.toolbox.names]
    return [f'{format_quoted(COLLECTION)}, "Collection"']


def list_all_tool_collections(dialogue: Dialogue, command: Command) -> Answer:
    """List a collection and all below it, as paths from the collection asked for."""
    names = dialogue.machine.toolbox.names
    if _collection(command.args):
        return [f'{format_quoted(name)}, "Tool"' for name in names]
    below = [f'{format_quoted(f"{COLLECTION}/{name}")}, "Tool"' for name in names]
    return [f'{format_quoted(COLLECTION)}, "Collection"', *below]


def open_tool_collection(dialogue: Dialogue, command: Command) -> Answer:
    """Check the path and do nothing: names in the collection are the tools' names already."""
    _collection(command.args)
    return ()


def _collection(args: tuple[Arg, ...]) -> bool:
    """Return whether the path is the collection's, not the root's (`/`).

    Raises `DmeError` for other paths.
    """
    path = [part for part in require_text(args).split("/") if part]
    if path not in ([], [COLLECTION]):
        raise DmeError(1504)
    return bool(path)


# --- properties ------------------------------------------------------------------------------


def get_prop(dialogue: Dialogue, command: Command) -> Answer:
    if not command.args:
        raise DmeError(502)
    parts: dict[str, str] = {}
    for arg in command.args:
        if not isinstance(arg, Property) or arg.values or arg.name in parts:
            raise DmeError(510 if isinstance(arg, Property) else 509)
        parts[arg.name] = _property(dialogue, arg.name)
    return [format_list(parts)]


def set_prop(dialogue: Dialogue, command: Command) -> Answer:
    """Set properties; clamp a value that is out of range, and warn."""
    if not command.args:
        raise DmeError(502)
    settings = [_setting(arg) for arg in command.args]
    for name, _ in settings:  # raises before anything is set
        _property(dialogue, name)
    clamped = False
    for name, value in settings:
        if name.startswith("Part."):
            dialogue.machine.part[name.removeprefix("Part.")] = value
        else:
            tool, below = _tool_and_name(dialogue, name)
            clamped = not tool.set_number(below, value) or clamped
    if clamped:
        dialogue.warn(command, DmeError(504))
    return ()


def list_properties(dialogue: Dialogue, command: Command) -> Answer:
    return [
        f"{format_quoted(name)}, {format_quoted(kind)}"
        for name, kind in _below(dialogue, command)
        if "." not in name
    ]


def list_all_properties(dialogue: Dialogue, command: Command) -> Answer:
    return [
        f"{format_quoted(name)}, {format_quoted(kind)}" for name, kind in _below(dialogue, command)
    ]


def _below(dialogue: Dialogue, command: Command) -> list[tuple[str, str]]:
    if len(command.args) != 1:
        raise DmeError(502)
    arg = command.args[0]
    if not isinstance(arg, Property) or arg.values:
        raise DmeError(509)
    tool, block = _tool_and_name(dialogue, arg.name)
    if block and not tool.measures:
        raise DmeError(507)
    return list(list_tool_properties(block))


def _setting(arg: Arg) -> tuple[str, float]:
    if not isinstance(arg, Property):
        raise DmeError(509)
    if len(arg.values) != 1 or not isinstance(arg.values[0], float):
        raise DmeError(510)
    return arg.name, arg.values[0]


def _property(dialogue: Dialogue, name: str) -> str:
    """Return a property's value as text; raises `DmeError` for an unknown property."""
    if is_2_5(dialogue) and name.startswith("Part."):
        value = dialogue.machine.part.get(name.removeprefix("Part."))
        if value is None:
            raise DmeError(510)
        return format_decimal(value, 9)
    tool, below = _tool_and_name(dialogue, name)
    if below in ("Name", "Id"):
        return format_quoted(tool.name)
    if below == "Collection" and is_2_5(dialogue):
        return format_quoted(COLLECTION)
    if below == "AvrRadius":
        return format_decimal(tool.radius_mm)
    if below == "Alignment":
        if name.startswith("FoundTool.") and not is_2_5(dialogue):
            raise DmeError(510)  # 1.4.3 gives a direction only to the tool in use
        return ", ".join(format_decimal(value, 6) for value in dialogue.machine.alignment())
    return format_decimal(tool.number(below))


def _tool_and_name(dialogue: Dialogue, name: str) -> tuple[Tool, str]:
    """Split `Tool.PtMeasPar.Speed` into the tool in use and the name that follows.

    `FoundTool` is the selected tool; raises `DmeError` for another head.
    """
    head, _, below = name.partition(".")
    toolbox = dialogue.machine.toolbox
    if head == "Tool":
        return toolbox.current, below
    if head == "FoundTool":
        return toolbox.selected, below
    raise DmeError(510)


def _bare(name: str) -> str:
    """Write a tool's name as 2.5 does.

    A name of letters and digits, a letter first, has no quotation marks.
    """
    is_name = name.isascii() and name.isalnum() and name[0].isalpha()
    return name if is_name else format_quoted(name)


METHODS = {
    "EnumTools": list_tools,
    "FindTool": find_tool,
    "ChangeTool": set_tool,
    "SetTool": set_tool,
    "GetChangeToolAction": get_change_tool_action,
    "ReQualify": refuse_qualification,
    "GetProp": get_prop,
    "GetPropE": get_prop,
    "SetProp": set_prop,
    "EnumProp": list_properties,
    "EnumAllProp": list_all_properties,
}
METHODS_2_5 = {
    "Tool": get_current_tool,
    "FoundTool": get_selected_tool,
    "IsAlignable": is_alignable,
    "EnumToolCollection": list_tool_collection,
    "EnumAllToolCollections": list_all_tool_collections,
    "OpenToolCollection": open_tool_collection,
}
