"""`calibrate`: geometry, thermal model and covariance from sessions."""

from __future__ import annotations

from typing import Literal

from armd.compensation.identify.calibrate import Options, ThermalMethod
from armd.compensation.identify.calibrate import calibrate as identify
from armd.compensation.progress import TellStep
from armd.errors import BadInput
from armd.offline.arm_model import ArmModel, PathText, resolve_arm
from armd.offline.calibration import Calibration, convert_calibration
from armd.offline.inputs.session import Sessions, load_sessions, resolve_sessions
from armd.offline.results.identified import Identified

ThermalOrder = Literal["auto", "off", 0, 1, 2, 3, 4]
METHODS = ("polynomial", "zones", "components", "per-temperature")
#: Order of the thermal model by its name; None: chosen by the data.
ORDERS: dict[str, int | None] = {
    "auto": None, "off": 0, "0": 0, "1": 1, "2": 2, "3": 3, "4": 4,
}  # fmt: skip
#: The command in the provenance of a calibration that no command made.
COMMAND = "armd.calibrate"


def calibrate(
    sessions: Sessions,
    arm: ArmModel | PathText,
    *,
    thermal: ThermalOrder = "auto",
    thermal_method: ThermalMethod = "polynomial",
    offset: bool = False,
    progress: TellStep | None = None,
    command: str = COMMAND,
) -> Calibration:
    """Identify geometry and, where temperatures allow it, the thermal model: `armd calibrate`.

    *sessions*: a `Session`, the path of a session's folder, or several of them. *arm*: an
    `ArmModel` or the path of an arm.toml. *thermal*: the thermal model's order, 0 or `"off"` to 4;
    `"auto"` decides by the error on held-out readings. *thermal_method*: `"polynomial"`, `"zones"`,
    `"components"` or `"per-temperature"`; *offset* is only for the last one. *progress* is called
    with each step; *command* is recorded in the calibration.

    Raises `armd.BadInput` where the sessions are not sufficient for these options.

    >>> calibration = armd.calibrate("measured/T20", "measured/arm.toml")
    >>> calibration.parameters.column_names
    ['name', 'unit', 'nominal', 'value', 'standard_uncertainty']
    """
    if str(thermal) not in ORDERS:
        raise BadInput("command line", "--thermal", repr(thermal), f"one of {', '.join(ORDERS)}")
    if thermal_method not in METHODS:
        expected = f"one of {', '.join(METHODS)}"
        raise BadInput("command line", "--thermal-method", repr(thermal_method), expected)
    if offset and thermal_method != "per-temperature":
        expected = "it with --thermal-method per-temperature; else C is in the constants"
        raise BadInput("command line", "--offset", thermal_method, expected)
    model = resolve_arm(arm)
    loaded, _ = load_sessions(resolve_sessions(sessions), model.content)
    options = Options(
        thermal_order=ORDERS[str(thermal)],
        thermal_method=thermal_method,
        offset=offset,
        command=command,
        arm_file=str(model.path),
    )
    result = identify(loaded, model.content, options, progress)
    return convert_calibration(result.calibration, Identified(result, loaded, model))
