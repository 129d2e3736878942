"""The methods that 2.5 adds to 1.4.3, and the table of methods of each version."""

from __future__ import annotations

from collections.abc import Mapping

from armd.daemon.bridges.ippdme import commands, commands_csy, commands_tool
from armd.daemon.bridges.ippdme.dialogue import Answer, Dialogue, Method
from armd.daemon.bridges.ippdme.errors import DmeError
from armd.daemon.bridges.ippdme.grammar import (
    Command,
    format_decimal,
    format_list,
    format_quoted,
    require_nothing,
    require_text,
)
from armd.daemon.bridges.ippdme.report import MOTION

#: Commands that only answer with an error: they are not listed as supported.
UNSUPPORTED = ("ReQualify",)
_SIX = dict.fromkeys(commands_csy.NAMES, "float")
#: Arguments and their types (2.5, table 2) of the commands that have any.
_ARGUMENTS: tuple[tuple[str, dict[str, str]], ...] = (
    ("GetErrorInfo", {"ErrorNumber": "int"}),
    ("StopDaemon", {"EventTag": "name"}),
    ("GetProp GetPropE SetProp", {"Properties": "enum"}),
    ("EnumProp EnumAllProp", {"Reference": "name"}),
    ("OnMoveReport OnMoveReportE", {"Time": "float", "Dis": "float", "Axes": "enum"}),
    ("OnPtMeasReport OnScanReport", {"Parameters": "enum"}),
    ("Get", {"Axes": "enum"}),
    ("PtMeas", {"Positions": "enum", "IJK": "enum"}),
    ("ChangeTool SetTool FindTool GetChangeToolAction", {"ToolName": "string"}),
    ("EnumToolCollection EnumAllToolCollections OpenToolCollection", {"NodeName": "string"}),
    ("SetCoordSystem GetCsyTransformation", {"CoordSystem": "name"}),
    ("SetCsyTransformation", {"CoordSystem": "name", **_SIX}),
    ("SaveNamedCsyTransformation", {"Name": "string", **_SIX}),
    ("SaveActiveCoordSystem LoadCoordSystem DeleteCoordSystem", {"Name": "string"}),
    ("GetNamedCsyTransformation ReadTemperatureSensor", {"Name": "string"}),
    ("GetSupportedArguments", {"CommandName": "string"}),
)
ARGUMENTS = {name: args for names, args in _ARGUMENTS for name in names.split()}
#: The temperature that a broken sensor reports.
DEFECT_C = -273.0


def get_supported_commands(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    return [format_quoted(name) for name in dialogue.methods if name not in UNSUPPORTED]


def get_supported_arguments(dialogue: Dialogue, command: Command) -> Answer:
    """Answer with the name and the type of each argument of a command."""
    name = require_text(command.args)
    if name not in dialogue.methods or name in UNSUPPORTED:
        raise DmeError(506)
    return [
        f"{format_quoted(arg)}, {format_quoted(kind)}"
        for arg, kind in ARGUMENTS.get(name, {}).items()
    ]


def list_name_spaces(dialogue: Dialogue, command: Command) -> Answer:
    """Answer with nothing: armd has no commands of its own."""
    require_nothing(command.args)
    return ()


def list_mover_axes(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    return [format_list(dict.fromkeys(MOTION, ""))]


def get_temperature_sensors(dialogue: Dialogue, command: Command) -> Answer:
    """List the sensors: all belong to the machine, which corrects for them."""
    require_nothing(command.args)
    return [
        f"Name({format_quoted(name)}), Kind(CMM), CMMTempCorrection(1)"
        for name in dialogue.machine.temperatures_c
    ]


def read_temperature_sensor(dialogue: Dialogue, command: Command) -> Answer:
    name = require_text(command.args)
    temperatures = dialogue.machine.temperatures_c
    if name not in temperatures:
        raise DmeError(505)
    return [_celsius(temperatures[name])]


def read_all_temperatures(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    return [
        f"Name({format_quoted(name)}), Temperature({_celsius(value)})"
        for name, value in dialogue.machine.temperatures_c.items()
    ]


def _celsius(value: float | None) -> str:
    return format_decimal(DEFECT_C if value is None else value, 2)


VERSIONS: dict[str, Mapping[str, Method]] = {
    "1.4.3": {**commands.METHODS, **commands_tool.METHODS, **commands_csy.METHODS}
}
VERSIONS["2.5"] = {
    **VERSIONS["1.4.3"],
    **commands_csy.METHODS_2_5,
    **commands_tool.METHODS_2_5,
    "OnMoveReport": commands.set_move_report,
    "GetSupportedCommands": get_supported_commands,
    "GetSupportedArguments": get_supported_arguments,
    "EnumNameSpaces": list_name_spaces,
    "EnumerateMoverAxes": list_mover_axes,
    "GetTemperatureSensors": get_temperature_sensors,
    "ReadTemperatureSensor": read_temperature_sensor,
    "ReadAllTemperatures": read_all_temperatures,
}
