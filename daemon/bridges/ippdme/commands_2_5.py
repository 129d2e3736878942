"""What 2.5 has beyond 1.4.3, and the table of methods of each version."""

from __future__ import annotations

from collections.abc import Mapping

from armd.daemon.bridges.ippdme import commands, commands_csy, commands_tool
from armd.daemon.bridges.ippdme.commands import nothing, text_of
from armd.daemon.bridges.ippdme.errors import DmeError
from armd.daemon.bridges.ippdme.grammar import Command, decimal, quoted
from armd.daemon.bridges.ippdme.session import Answer, Method, Session

#: What a sensor that is broken reads.
DEFECT_C = -273.0


def get_supported_commands(session: Session, command: Command) -> Answer:
    nothing(command.args)
    return [quoted(name) for name in session.methods]


def get_temperature_sensors(session: Session, command: Command) -> Answer:
    """All of them are the machine's, and corrected for."""
    nothing(command.args)
    return [
        f"Name({quoted(name)}), Kind(CMM), CMMTempCorrection(1)"
        for name in session.machine.temperatures_c
    ]


def read_temperature_sensor(session: Session, command: Command) -> Answer:
    name = text_of(command.args)
    temperatures = session.machine.temperatures_c
    if name not in temperatures:
        raise DmeError(505)
    return [_celsius(temperatures[name])]


def read_all_temperatures(session: Session, command: Command) -> Answer:
    nothing(command.args)
    return [
        f"Name({quoted(name)}), Temperature({_celsius(value)})"
        for name, value in session.machine.temperatures_c.items()
    ]


def _celsius(value: float | None) -> str:
    return decimal(DEFECT_C if value is None else value, 2)


VERSIONS: dict[str, Mapping[str, Method]] = {
    "1.4.3": {**commands.METHODS, **commands_tool.METHODS, **commands_csy.METHODS}
}
VERSIONS["2.5"] = {
    **VERSIONS["1.4.3"],
    **commands_csy.METHODS_2_5,
    "OnMoveReport": commands.on_move_report,
    "GetSupportedCommands": get_supported_commands,
    "GetTemperatureSensors": get_temperature_sensors,
    "ReadTemperatureSensor": read_temperature_sensor,
    "ReadAllTemperatures": read_all_temperatures,
}
