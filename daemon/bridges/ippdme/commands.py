"""The methods of every version: sessions, errors, daemons, the user, positions and hits.

A method takes the dialogue and the command, and returns the data lines of its answer, or `Pending`.
"""

from __future__ import annotations

import math

import numpy as np

from armd.daemon.bridges.ippdme.dialogue import Answer, Dialogue, Pending, is_2_5
from armd.daemon.bridges.ippdme.errors import TABLE, DmeError
from armd.daemon.bridges.ippdme.grammar import (
    EVENT_TAG,
    Arg,
    Command,
    Property,
    format_list,
    format_quoted,
    require_nothing,
    require_word,
)
from armd.daemon.bridges.ippdme.report import (
    HIT,
    HIT_2_5,
    MOTION,
    SCAN,
    ReportedFields,
    format_fields,
    make_move_report,
    parse_names,
)

MACHINE_CLASS = '"CartCMM"'
#: 2.5, annex J.1: manual machine with tactile probe.
MACHINE_CLASS_2_5 = '"CartCMM_TouchTrigger_Fixed_None_ToolChanger_None_None"'


def start_session(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    dialogue.start_session()
    return ()


def close_session(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    dialogue.end_session()
    return ()


def get_dme_version(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    return [f"DMEVersion({format_quoted(dialogue.version)})"]


def get_machine_class(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    if is_2_5(dialogue):
        return [MACHINE_CLASS_2_5]
    return [f"GetMachineClass({MACHINE_CLASS})"]


# --- errors ----------------------------------------------------------------------------------


def get_error_info(dialogue: Dialogue, command: Command) -> Answer:
    if len(command.args) != 1:
        raise DmeError(502)
    number = command.args[0]
    if not isinstance(number, float):
        raise DmeError(509)
    if number not in TABLE:
        raise DmeError(504)
    return [format_quoted(TABLE[int(number)][1])]


def clear_all_errors(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    dialogue.errors.clear()
    return ()


def get_err_status(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    status = "1" if dialogue.errors else "0"
    return [status if is_2_5(dialogue) else f"ErrStatus({status})"]


def get_xtd_err_status(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    lines = [_is_homed(dialogue), f"IsUserEnabled({int(dialogue.user_enabled)})"]
    if is_2_5(dialogue):
        return lines + [
            f"ActiveError({error.number:04d}), Severity({error.severity})"
            for error, _ in dialogue.errors
        ]
    dialogue.answer_errors(command.tag, lines)
    return ()


def stop_motion(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    dialogue.abort()
    return ()


# --- daemons ---------------------------------------------------------------------------------


def set_move_report(dialogue: Dialogue, command: Command) -> Answer:
    if not EVENT_TAG.fullmatch(command.tag):
        raise DmeError(502)  # its reports need an event tag
    report = make_move_report(command.tag, command.args, both_needed=is_2_5(dialogue))
    if dialogue.move_report is not None:
        raise DmeError(515)
    dialogue.move_report = report
    return ()


def stop_daemon(dialogue: Dialogue, command: Command) -> Answer:
    tag = require_word(command.args)
    if not EVENT_TAG.fullmatch(tag):
        raise DmeError(509)
    if dialogue.move_report is None or dialogue.move_report.tag != tag:
        raise DmeError(513)
    dialogue.move_report = None
    return ()


def stop_all_daemons(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    if dialogue.move_report is None:
        raise DmeError(512)
    dialogue.move_report = None
    return ()


# --- the user --------------------------------------------------------------------------------


def move_home(dialogue: Dialogue, command: Command) -> Answer:
    """Answer at once, as the encoders are absolute; error 1005 unless all joints are known."""
    require_nothing(command.args)
    dialogue.user_enabled = False
    if not dialogue.machine.homed:
        raise DmeError(1005)
    return ()


def is_homed(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    return [_is_homed(dialogue)]


def _is_homed(dialogue: Dialogue) -> str:
    return f"IsHomed({int(dialogue.machine.homed)})"


def enable_user(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    dialogue.user_enabled = True
    return ()


def disable_user(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    dialogue.user_enabled = False
    return ()


def is_user_enabled(dialogue: Dialogue, command: Command) -> Answer:
    require_nothing(command.args)
    return [f"IsUserEnabled({int(dialogue.user_enabled)})"]


# --- positions and hits ----------------------------------------------------------------------


def set_point_report(dialogue: Dialogue, command: Command) -> Answer:
    dialogue.report = parse_names(command.args, HIT_2_5 if is_2_5(dialogue) else HIT)
    return ()


def set_scan_report(dialogue: Dialogue, command: Command) -> Answer:
    """Accept the command, because hosts send it at their start; an arm does not scan."""
    parse_names(command.args, SCAN)
    return ()


def get(dialogue: Dialogue, command: Command) -> Answer:
    names = parse_names(command.args, MOTION)
    x, y, z = dialogue.machine.position().tolist()
    return [format_list(format_fields(names, {"X": (x,), "Y": (y,), "Z": (z,)}))]


def measure_point(dialogue: Dialogue, command: Command) -> Answer:
    """Answer with the operator's next hit near the host's nominal point."""
    nominal = _nominal(command.args)
    tool = dialogue.machine.toolbox.current
    if not tool.measures:
        raise DmeError(507)
    dialogue.machine.check_reach(nominal)
    dialogue.user_enabled = False
    pending = Pending()
    reach_mm = tool.number("PtMeasPar.Search") + tool.radius_mm

    def take(fields: ReportedFields) -> None:
        dialogue.hit = None
        away = math.hypot(*(fields[axis][0] - nominal_mm for axis, nominal_mm in nominal.items()))
        if away > reach_mm:
            pending.settle(DmeError(1006))
        else:
            pending.settle([format_list(format_fields(dialogue.report, fields))])

    dialogue.hit = take
    return pending


def _nominal(args: tuple[Arg, ...]) -> dict[str, float]:
    """Return the nominal coordinates by axis; raises `DmeError`."""
    if not args:
        raise DmeError(502)
    values: dict[str, float] = {}
    names = set()
    for arg in args:
        if not isinstance(arg, Property):
            raise DmeError(509)
        numbers = [value for value in arg.values if isinstance(value, float)]
        expected = 3 if arg.name == "IJK" else 1
        if arg.name not in (*MOTION, "IJK") or arg.name in names or len(numbers) != expected:
            raise DmeError(510)
        names.add(arg.name)
        if arg.name == "IJK":
            if not np.any(numbers):
                raise DmeError(1010)
        else:
            values[arg.name] = numbers[0]
    return values


METHODS = {
    "StartSession": start_session,
    "EndSession": close_session,
    "GetDMEVersion": get_dme_version,
    "GetMachineClass": get_machine_class,
    "GetErrorInfo": get_error_info,
    "ClearAllErrors": clear_all_errors,
    "GetErrStatusE": get_err_status,
    "GetXtdErrStatus": get_xtd_err_status,
    "AbortE": stop_motion,
    "OnMoveReportE": set_move_report,
    "StopDaemon": stop_daemon,
    "StopAllDaemons": stop_all_daemons,
    "Home": move_home,
    "IsHomed": is_homed,
    "EnableUser": enable_user,
    "DisableUser": disable_user,
    "IsUserEnabled": is_user_enabled,
    "OnPtMeasReport": set_point_report,
    "OnScanReport": set_scan_report,
    "Get": get,
    "PtMeas": measure_point,
}
