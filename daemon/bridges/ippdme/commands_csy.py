"""The methods about coordinate systems."""

from __future__ import annotations

from armd.daemon.bridges.ippdme.csy import Transformation
from armd.daemon.bridges.ippdme.dialogue import Answer, Dialogue, is_2_5
from armd.daemon.bridges.ippdme.errors import DmeError
from armd.daemon.bridges.ippdme.grammar import (
    Arg,
    Command,
    Text,
    Word,
    format_decimal,
    format_list,
    format_quoted,
    require_nothing,
    require_text,
    require_word,
)

NAMES = ("X0", "Y0", "Z0", "Theta", "Psi", "Phi")
PLACES = 6


def set_coord_system(dialogue: Dialogue, command: Command) -> Answer:
    dialogue.machine.systems.select(require_word(command.args))
    dialogue.report_now()
    return ()


def get_coord_system(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    selected = dialogue.machine.systems.selected
    return [selected if is_2_5(dialogue) else f"CoordSystem({selected})"]


def set_csy_transformation(dialogue: Dialogue, command: Command) -> Answer:
    name, transformation = _named(command.args, Word)
    dialogue.machine.systems.set(name, transformation)
    dialogue.report_now()
    return ()


def get_csy_transformation(dialogue: Dialogue, command: Command) -> Answer:
    transformation = dialogue.machine.systems.get(require_word(command.args))
    return [_written(transformation, dialogue)]


def save_active(dialogue: Dialogue, command: Command) -> Answer:
    """Save the part's coordinate system under a name."""
    systems = dialogue.machine.systems
    systems.save_named(require_text(command.args), systems.get("PartCsy"))
    return ()


def load(dialogue: Dialogue, command: Command) -> Answer:
    """Make a named coordinate system the part's, and select it."""
    systems = dialogue.machine.systems
    systems.set("PartCsy", systems.find_named(require_text(command.args)))
    systems.select("PartCsy")
    dialogue.report_now()
    return ()


def remove(dialogue: Dialogue, command: Command) -> Answer:
    dialogue.machine.systems.delete_named(require_text(command.args))
    return ()


def list_named(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    return [format_quoted(name) for name in dialogue.machine.systems.named]


def save_named(dialogue: Dialogue, command: Command) -> Answer:
    name, transformation = _named(command.args, Text)
    dialogue.machine.systems.save_named(name, transformation)
    return ()


def get_named(dialogue: Dialogue, command: Command) -> Answer:
    return [_written(dialogue.machine.systems.find_named(require_text(command.args)), dialogue)]


def _named(args: tuple[Arg, ...], kind: type[Word] | type[Text]) -> tuple[str, Transformation]:
    if len(args) != 1 + len(NAMES):
        raise DmeError(502)
    name, *numbers = args
    values = [number for number in numbers if isinstance(number, float)]
    if not isinstance(name, kind) or len(values) != len(NAMES):
        raise DmeError(509)
    return name.value, Transformation(*values)


def _written(transformation: Transformation, dialogue: Dialogue) -> str:
    values = [format_decimal(value, PLACES) for value in transformation]
    if is_2_5(dialogue):
        return format_list(dict(zip(NAMES, values, strict=True)))
    return f"GetCsyTransformation({', '.join(values)})"


METHODS = {
    "SetCoordSystem": set_coord_system,
    "GetCoordSystem": get_coord_system,
    "SetCsyTransformation": set_csy_transformation,
    "GetCsyTransformation": get_csy_transformation,
}
METHODS_2_5 = {
    "SaveActiveCoordSystem": save_active,
    "LoadCoordSystem": load,
    "DeleteCoordSystem": remove,
    "EnumCoordSystems": list_named,
    "SaveNamedCsyTransformation": save_named,
    "GetNamedCsyTransformation": get_named,
}
