"""`armd.toml`: the daemon's configuration. docs/reference/configure.md describes every key."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, create_model

from armd import keys
from armd.compensation.model.arm import Arm, Offset, load_arm
from armd.compensation.model.parameters import MOST_JOINTS
from armd.drivers.can.objects import CHANNELS_PER_MODULE, TEMPERATURE_NODES
from armd.drivers.config import (
    CanConfig,
    DriverConfig,
    MicroScribeConfig,
    ReplayConfig,
    SerialConfig,
    ServoConfig,
)
from armd.drivers.identity import Expectation
from armd.drivers.microscribe.wire import N_JOINTS
from armd.drivers.poll.protocol.family import COUNTS_PER_TURN
from armd.drivers.serial.wire import SERIAL_NUMBER_BYTES
from armd.drivers.table import DRIVERS
from armd.errors import ArmdError, BadInput
from armd.files.inputs import MOST_TOML_BYTES, read_input
from armd.files.schema import Strict, decode_toml, validate

if TYPE_CHECKING:
    from armd.drivers.plugin import DriverPlugin

#: Limit of the live path, which is compiled ahead for and tested with so many joints.
MOST_LIVE_JOINTS = 9

Seconds = Annotated[float, Field(gt=0, le=3600)]
Endpoint = Annotated[str, Field(pattern=r"^[a-z0-9-]+/.+$", description="e.g. tcp/127.0.0.1:7447")]


class Zenoh(Strict):
    """The settings of Zenoh; it listens only on loopback unless other endpoints are named here."""

    mode: Literal["peer", "client", "router"] = "peer"
    listen: list[Endpoint] = ["tcp/127.0.0.1:7447"]
    connect: list[Endpoint] = []
    #: A whole Zenoh configuration (JSON5) instead of the three above: TLS, users, access control.
    config: str | None = None


class Limits(Strict):
    """Limits beyond which a point is flagged or withheld."""

    #: A temperature older than this makes points invalid; until then the last value is held.
    temperature_hold_s: Seconds = 30.0
    #: Flag 3 above this rate, if the calibration does not state a lower one.
    temperature_rate_k_per_h: Annotated[float, Field(gt=0)] = 60.0
    #: A reload or a tip change that moves the tip's offset further than this gives a warning.
    tip_offset_mm: Annotated[float, Field(gt=0)] = 0.1


class Health(Strict):
    """Conditions under which the state is not READY."""

    #: WARMING while a sensor in use drifts faster than this.
    steady_k_per_h: Annotated[float, Field(gt=0)] = 6.0
    #: On a foreign arm: keep waiting for the right one, or stop with exit code 2.
    foreign_arm: Literal["wait", "stop"] = "wait"


class Interim(Strict):
    """The history of interim checks that shows whether the arm is unchanged."""

    #: The folder of `armd interim add --history`, relative to this file.
    history: str
    #: The state leaves READY when the last check is older, in hours; without it never.
    at_most_h: Annotated[float, Field(gt=0)] | None = None


class Averaging(Strict):
    """The trigger of a measurement, and the time over which it is averaged."""

    #: A button press always takes a measurement; "rest" takes one at each rest as well.
    trigger: Literal["button", "rest"] = "button"
    #: The longest stretch of rest that is averaged.
    average_s: Annotated[float, Field(gt=0, le=5)] = 0.5
    #: Whether measurements are kept on this machine's disk, in the state folder.
    log: bool = True


class Commands(Strict):
    """Whether commands on `armd/<serial>/command/…` are carried out."""

    enabled: bool = False


class Metrics(Strict):
    """OpenMetrics over HTTP on loopback; absent: no port is opened."""

    port: Annotated[int, Field(ge=1, le=65535)]


class Tip(Strict):
    """A tip that can be selected while running."""

    offset_mm: Offset
    #: Radius of its ball; without it arm.toml's.
    radius_mm: Annotated[float, Field(ge=0)] | None = None


class DaemonFile(Strict):
    """The content of armd.toml; paths are relative to the file."""

    schema_: Literal["armd.daemon/1"] = Field(alias="schema")
    arm: str
    calibration: str | None = None
    driver: DriverConfig
    zenoh: Zenoh = Zenoh()
    limits: Limits = Limits()
    health: Health = Health()
    interim: Interim | None = None
    measurement: Averaging = Averaging()
    commands: Commands = Commands()
    metrics: Metrics | None = None
    tips: dict[str, Tip] = {}


@dataclass(frozen=True)
class Config:
    """armd.toml and the arm it names, checked together."""

    path: Path
    file: DaemonFile
    arm: Arm

    def resolve_path(self, name: str) -> Path:
        """Return a path named in the file, relative to the file's folder."""
        return self.path.parent / name

    @property
    def driver(self) -> DriverConfig | DriverPlugin:
        driver = self.file.driver
        if isinstance(driver, ReplayConfig):
            return driver.model_copy(update={"file": str(self.resolve_path(driver.file))})
        return driver

    @property
    def calibration(self) -> Path | None:
        return None if self.file.calibration is None else self.resolve_path(self.file.calibration)

    @property
    def expectation(self) -> Expectation:
        """The properties that the arm on the wire must report."""
        return Expectation(
            self.arm.serial_number,
            self.arm.n_joints,
            len(self.arm.sensors),
            tuple(joint.counts_per_turn for joint in self.arm.joint),
        )


def load_config(path: str | Path) -> Config:
    """Read armd.toml and its arm.toml.

    Raises `BadInput`, which names file, key, the value found and the expected one.
    """
    data = decode_toml(path, read_input(path, MOST_TOML_BYTES))
    model = _choose_model(path, data)
    try:
        file = validate(path, data, model)
    except Exception as error:
        if model is DaemonFile or isinstance(error, ArmdError):
            raise
        problem = f"{type(error).__name__}: {error}"
        raise BadInput(path, "driver", problem, "keys that its package can check") from error
    config_path = Path(path).absolute()
    arm_path = config_path.parent / file.arm
    arm = load_arm(arm_path)
    if arm.n_joints > MOST_LIVE_JOINTS:
        expected = f"3 to {MOST_LIVE_JOINTS} of a live arm (offline commands take {MOST_JOINTS})"
        raise BadInput(arm_path, "joint", f"{arm.n_joints} of them", expected)
    for k, joint in enumerate(arm.joint, 1):
        if joint.counts_per_turn is None:
            location = f"joint[{k}].counts_per_turn"
            raise BadInput(arm_path, location, "nothing", "a number: a live arm sends counts")
    if isinstance(file.driver, ServoConfig):
        _check_servos(path, file.driver, arm_path, arm)
    elif isinstance(file.driver, CanConfig):
        _check_nodes(path, file.driver, arm_path, arm)
    elif isinstance(file.driver, MicroScribeConfig) and arm.n_joints != N_JOINTS:
        expected = f"{N_JOINTS}, a MicroScribe's"
        raise BadInput(arm_path, "joint", f"{arm.n_joints} joints", expected)
    if isinstance(file.driver, SerialConfig) and len(arm.serial_number) > SERIAL_NUMBER_BYTES:
        problem = f"{len(arm.serial_number)} characters"
        expected = f"{SERIAL_NUMBER_BYTES} at most, which the serial wire carries"
        raise BadInput(arm_path, "serial_number", problem, expected)
    if keys.FORBIDDEN & set(arm.serial_number):
        expected = f"none of {' '.join(sorted(keys.FORBIDDEN))}, it becomes a part of Zenoh keys"
        raise BadInput(arm_path, "serial_number", repr(arm.serial_number), expected)
    if file.zenoh.config and file.zenoh.model_fields_set - {"config"}:
        key = min(file.zenoh.model_fields_set - {"config"})
        raise BadInput(path, f"zenoh.{key}", "this key", "it inside zenoh.config, or no config")
    return Config(config_path, file, arm)


def _choose_model(path: str | Path, data: dict[str, Any]) -> type[DaemonFile]:
    """Return the model of armd.toml; a `kind` of another package adds its keys.

    Raises `BadInput` for an unknown kind where other packages offer kinds.
    """
    driver = data.get("driver")
    kind = driver.get("kind") if isinstance(driver, dict) else None
    if not isinstance(kind, str) or kind in DRIVERS:
        return DaemonFile
    from armd.drivers.plugin import list_plugin_kinds, load_plugin_driver

    plugin = load_plugin_driver(kind, DRIVERS)
    if plugin is not None:
        return create_model("DaemonFile", __base__=DaemonFile, driver=(plugin, ...))
    if plugins := list_plugin_kinds(DRIVERS):
        kinds = ", ".join(map(repr, [*DRIVERS, *plugins]))
        raise BadInput(path, "driver.kind", repr(kind), f"one of {kinds}")
    return DaemonFile


def _check_nodes(path: str | Path, driver: CanConfig, arm_path: Path, arm: Arm) -> None:
    """Check that a bus has enough nodes for the arm; raises `BadInput`."""
    numbers = driver.encoder_serial_numbers
    if numbers is not None and len(numbers) != arm.n_joints:
        problem, expected = f"{len(numbers)} numbers", f"{arm.n_joints}, one for each joint"
        raise BadInput(path, "driver.encoder_serial_numbers", problem, expected)
    n_channels = CHANNELS_PER_MODULE * len(TEMPERATURE_NODES)
    if len(arm.sensors) > n_channels:
        expected = f"{n_channels} at most, the channels of {len(TEMPERATURE_NODES)} modules on CAN"
        raise BadInput(arm_path, "temperature_sensor", f"{len(arm.sensors)} sensors", expected)


def _check_servos(path: str | Path, driver: ServoConfig, arm_path: Path, arm: Arm) -> None:
    """Check that the named servos match the arm; raises `BadInput`."""
    if len(driver.ids) != arm.n_joints:
        problem, expected = f"{len(driver.ids)} servos", f"{arm.n_joints}, one for each joint"
        raise BadInput(path, "driver.ids", problem, expected)
    if driver.temperature_ids is not None and len(driver.temperature_ids) != len(arm.sensors):
        problem = f"{len(driver.temperature_ids)} servos"
        expected = f"{len(arm.sensors)}, one for each temperature_sensor of {arm_path.name}"
        raise BadInput(path, "driver.temperature_ids", problem, expected)
    if driver.temperature_ids is None and len(arm.sensors) > len(driver.ids):
        problem = f"nothing, and {len(arm.sensors)} sensors in {arm_path.name}"
        raise BadInput(path, "driver.temperature_ids", problem, "the servo of each sensor")
    for k, joint in enumerate(arm.joint, 1):
        if joint.counts_per_turn != COUNTS_PER_TURN:
            location = f"joint[{k}].counts_per_turn"
            problem, expected = str(joint.counts_per_turn), f"{COUNTS_PER_TURN}, a servo's"
            raise BadInput(arm_path, location, problem, expected)
