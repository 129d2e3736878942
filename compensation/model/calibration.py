"""`calibration.json`: identified constants and terms, their range of validity, their origin.

There are two hashes. `content_sha256` inside the file protects its content against edits and
damage. The file's own SHA-256 is its identity; every point carries its first eight bytes. Both are
computed once from the bytes as read, so defaults of missing fields are part of neither.
"""

from __future__ import annotations

import datetime
import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from armd.arrays import F64
from armd.compensation.model import parameters
from armd.compensation.model.arm import Arm, Celsius, Vector3
from armd.compensation.model.parameters import MOST_JOINTS, ParameterLayout
from armd.compensation.model.slow_factors import Period, SlowFactor
from armd.compensation.model.terms import Term
from armd.errors import BadInput
from armd.files.inputs import read_input
from armd.files.schema import Strict, load_json_data, validate
from armd.files.writing import write_whole

#: A diagnosis writes dozens; a sample pays 5 ns for each that depends on the pose.
MOST_TERMS = 10_000
#: The terms checked in one call: the validator must not delay the thread that streams points.
TERMS_AT_ONCE = 100
#: Larger values cannot be an arm's constants: 100 m, and 100 rad are sixteen turns.
MOST_MM, MOST_RAD, MOST_K = 1e5, 100.0, 1e3

#: The tolerance of a correlation, because numbers with five digits are rounded.
MOST_ROUNDED = 1e-4


class Noise(Strict):
    """The noise that the identification estimated: the floor of every uncertainty."""

    #: per joint, standard deviation
    encoder_rad: Annotated[
        list[Annotated[float, Field(ge=0, le=MOST_RAD)]], Field(max_length=MOST_JOINTS)
    ] = []
    reading_mm: Annotated[float, Field(ge=0, le=MOST_MM)] = (
        0.0  # repeatability of one reading, per axis
    )
    temperature_c: Annotated[float, Field(ge=0, le=MOST_K)] = 0.0


class ArtefactCorrection(Strict):
    """Errors of the artefact, found by a diagnosis; `evaluate` applies them, `correct` does not."""

    #: names of the artefacts with these errors; empty (older files): any
    artefacts: list[str] = []

    expansion_per_k: float | None = None
    target_offset_mm: dict[str, Vector3] = {}
    scale: float = 1.0


class Calibration(Strict):
    """The content of a calibration file. `terms` may depend on any state the daemon knows."""

    schema_: Literal["armd.calibration/1"] = Field(
        default="armd.calibration/1", alias="schema", serialization_alias="schema"
    )
    arm: str
    created: str  # ISO 8601, UTC
    reference_temperature_c: Celsius
    #: sensor name → [lowest, highest] °C during the identification; empty: not thermal
    temperature_range_c: dict[str, tuple[float, float]] = {}
    #: K/h; a faster change sets flag 3
    max_temperature_rate_k_per_h: Annotated[float, Field(gt=0)] | None = None
    constants: dict[str, float]  # every parameter by name, mm and rad
    terms: Annotated[list[Term], Field(max_length=MOST_TERMS)] = []
    #: covariance of the identified quantities, in the order of `covariance_of`; an entry is a
    #: parameter's name or "term I" (index into `terms`)
    covariance_of: list[str] = []
    covariance: list[list[float]] = []
    noise: Noise = Noise()
    artefact: ArtefactCorrection | None = None
    provenance: dict[str, Any] = {}
    content_sha256: str = ""

    @model_validator(mode="after")
    def _consistent(self) -> Calibration:
        n = len(self.covariance_of)
        if len(self.covariance) != n or any(len(row) != n for row in self.covariance):
            raise ValueError(f"a covariance of {n} × {n}, one row per entry of covariance_of")
        for i, name in enumerate(self.covariance_of):
            if self.covariance[i][i] < 0:
                raise ValueError(f"variances of 0 or more, not {self.covariance[i][i]:g} of {name}")
        self._refuse_indefinite()
        return self

    def _refuse_indefinite(self) -> None:
        """Raise `ValueError` for an asymmetric covariance or one with a negative variance."""
        if not self.covariance:
            return
        covariance = np.array(self.covariance)
        deviation = np.sqrt(np.diag(covariance))
        scale = np.where(deviation > 0, deviation, 1.0)
        with np.errstate(over="ignore"):
            correlation = covariance / scale[:, None] / scale
        varies = deviation > 0
        wrong = ~(np.abs(correlation) <= 1.0 + MOST_ROUNDED)
        wrong |= (correlation != 0) & ~(varies[:, None] & varies)
        wrong |= ~(np.abs(correlation - correlation.T) <= MOST_ROUNDED)
        if wrong.any():
            i, j = (int(k) for k in np.argwhere(wrong)[0])
            first, second = self.covariance_of[i], self.covariance_of[j]
            raise ValueError(
                f"a symmetric covariance with correlations of ±1 at most, not {first} with"
                f" {second}: {self.covariance[i][j]:g} and {self.covariance[j][i]:g}, standard"
                f" deviations {deviation[i]:g} and {deviation[j]:g}"
            )
        least_eigenvalue = float(np.linalg.eigvalsh((correlation + correlation.T) / 2)[0])
        if least_eigenvalue < -MOST_ROUNDED * len(correlation):
            raise ValueError(
                "a positive semidefinite covariance: of some combination of the quantities the"
                f" variance is negative ({least_eigenvalue:.3g} of that of one alone)"
            )

    def vector(self, n_joints: int) -> F64:
        """Return the constants as the parameter vector (5 N + 9,)."""
        names = ParameterLayout(n_joints).names
        return np.array([self.constants.get(name, 0.0) for name in names])

    def content(self) -> dict[str, Any]:
        """Return all fields except the hash, as plain JSON data."""
        return self.model_dump(mode="json", by_alias=True, exclude={"content_sha256"})


@dataclass(frozen=True)
class LoadedCalibration:
    """A calibration and the identity of the file it came from."""

    content: Calibration
    sha256: str
    path: Path
    data: bytes = b""  # the bytes of the file as read

    @property
    def identity(self) -> int:
        """The first eight bytes of the SHA-256, as the point carries them (u64, little-endian)."""
        return int.from_bytes(bytes.fromhex(self.sha256)[:8], "little")


def name_constants(vector: F64, n_joints: int) -> dict[str, float]:
    """Return a parameter vector as the mapping that a calibration stores."""
    return dict(zip(ParameterLayout(n_joints).names, map(float, vector), strict=True))


def load_calibration(path: str | Path, arm: Arm | None = None) -> LoadedCalibration:
    """Read a calibration once and, given *arm*, check that it belongs to it.

    Raises `BadInput` for a malformed file, content that does not match its hash, another arm's
    calibration, or names the arm does not have.
    """
    data = read_input(path)
    calibration = parse_calibration(path, data)
    if arm is not None:
        check_belongs(path, calibration, arm)
    return LoadedCalibration(calibration, hashlib.sha256(data).hexdigest(), Path(path), data)


def parse_calibration(path: str | Path, data: bytes) -> Calibration:
    """Parse *data*, the bytes of the file *path*; raises `BadInput`."""
    try:
        return _parse(path, data)
    except (MemoryError, RecursionError, ValueError) as error:
        actual = f"content that cannot be read ({type(error).__name__})"
        raise BadInput(path, "the file", actual, "a calibration") from error


def save_calibration(
    path: str | Path,
    calibration: Calibration,
    write: Callable[[str | Path, bytes], None] = write_whole,
) -> LoadedCalibration:
    """Write the calibration whole or not at all; return what a reader will load."""
    content = calibration.content()
    content["content_sha256"] = hash_content(content)
    data = (json.dumps(content, indent=1, allow_nan=False) + "\n").encode()
    write(path, data)
    # Not read back, because a pipe cannot be read back.
    return LoadedCalibration(_parse(path, data), hashlib.sha256(data).hexdigest(), Path(path), data)


def hash_content(content: Mapping[str, Any]) -> str:
    """Compute the SHA-256 of the canonical JSON of *content* without its key `content_sha256`.

    Canonical: keys sorted, no spaces. Lists are encoded element by element, so that no call takes
    long.
    """
    digest = hashlib.sha256(b"{")
    for i, key in enumerate(sorted(content.keys() - {"content_sha256"})):
        digest.update(f"{',' if i else ''}{json.dumps(key)}:".encode())
        for piece in _canonical(content[key]):
            digest.update(piece.encode())
    digest.update(b"}")
    return digest.hexdigest()


def _canonical(value: Any) -> Iterator[str]:
    if not isinstance(value, list):
        yield json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
        return
    yield "["
    for i, element in enumerate(value):
        if i:
            yield ","
        yield json.dumps(element, sort_keys=True, separators=(",", ":"), allow_nan=False)
    yield "]"


def _parse(path: str | Path, data: bytes) -> Calibration:
    """Parse and check a file's content; an impossible value is reported before a wrong hash."""
    content = load_json_data(path, data)
    if not isinstance(content, dict):
        raise BadInput(path, "the file", type(content).__name__, "an object, { … }")
    listed = content.get("terms", [])
    if isinstance(listed, list) and len(listed) > MOST_TERMS:
        raise BadInput(path, "terms", f"{len(listed)} terms", f"{MOST_TERMS} at most")
    written = hash_content(content)
    if not isinstance(listed, list):
        listed = []  # reported by the validator
    else:
        content = content | {"terms": []}
    calibration = validate(path, content, Calibration)
    terms: list[Term] = []
    for start in range(0, len(listed), TERMS_AT_ONCE):
        piece = {"terms": listed[start : start + TERMS_AT_ONCE]}
        terms += validate(path, piece, _Terms, {"terms": start}).terms
    if calibration.content_sha256 != written:
        raise BadInput(
            path,
            "content_sha256",
            "a content that does not match it (edited or damaged)",
            "the file as it was written",
        )
    ends_s = _created_unix_s(path, calibration)
    return calibration.model_copy(update={"terms": [_ended(term, ends_s) for term in terms]})


class _Terms(Strict):
    """A part of a calibration's terms."""

    terms: list[Term]


def _created_unix_s(path: str | Path, calibration: Calibration) -> float:
    try:
        created = datetime.datetime.fromisoformat(calibration.created)
        return created.replace(tzinfo=created.tzinfo or datetime.UTC).timestamp()
    except (ValueError, OverflowError) as error:
        raise BadInput(
            path, "created", repr(calibration.created), "an instant (ISO 8601)"
        ) from error


def _ended(term: Term, created_unix_s: float) -> Term:
    """Return the term with an end of its period, if the file states none.

    The end is the instant at which the file was made, because nobody measured later.
    """
    if not any(isinstance(factor, Period) and factor.until_unix_s is None for factor in term.basis):
        return term
    basis = [
        factor.model_copy(update={"until_unix_s": max(created_unix_s, factor.since_unix_s)})
        if isinstance(factor, Period) and factor.until_unix_s is None
        else factor
        for factor in term.basis
    ]
    return term.model_copy(update={"basis": basis})


def list_used_sensors(arm: Arm, calibration: Calibration | None) -> set[str]:
    """Return the names of the sensors that a joint or a term of the calibration depends on."""
    used = set(arm.used_sensors)
    return used | list_sensors(calibration.terms) if calibration is not None else used


def list_sensors(terms: Sequence[Term]) -> set[str]:
    """Return the names of the sensors that terms depend on with a non-zero weight."""
    return {
        name
        for term in terms
        for factor in term.basis
        if isinstance(factor, SlowFactor)
        for weights, _ in factor.means
        for name, weight in weights.items()
        if weight
    }


def check_belongs(path: str | Path, calibration: Calibration, arm: Arm) -> None:
    """Raise `BadInput` unless *calibration*, of the file *path*, is one of *arm*."""
    if calibration.arm != arm.serial_number:
        raise BadInput(path, "arm", repr(calibration.arm), f"{arm.serial_number!r}, as in arm.toml")
    parameter_names = set(arm.layout.names)
    for name, value in calibration.constants.items():
        if name not in parameter_names:
            raise BadInput(path, f"constants.{name}", "this name", "a parameter of the arm")
        limit = MOST_MM if (unit := parameters.find_unit(name)) == "mm" else MOST_RAD
        if abs(value) > limit:
            raise BadInput(path, f"constants.{name}", f"{value:g} {unit}", f"{limit:g} at most")
    missing = sorted(parameter_names - set(calibration.constants))
    if missing:
        raise BadInput(path, f"constants.{missing[0]}", "nothing", "a value for every parameter")
    numbered = {f"term {i}" for i in range(len(calibration.terms))}
    for name in calibration.covariance_of:
        if name not in parameter_names | numbered:
            expected = 'a parameter of the arm or "term I", I counting `terms` from 0'
            raise BadInput(path, "covariance_of", repr(name), expected)
    check_terms(path, calibration.terms, arm)


def check_terms(path: str | Path, terms: Sequence[Term], arm: Arm) -> None:
    """Raise `BadInput`, which names *path*, for terms that do not fit *arm*.

    Each term must be of the arm's parameters, joints and sensors.
    """
    parameter_names = set(arm.layout.names)
    for i, term in enumerate(terms, 1):
        if term.parameter not in parameter_names:
            raise BadInput(
                path, f"terms[{i}].parameter", repr(term.parameter), "a parameter of the arm"
            )
        for factor in term.basis:
            joint = getattr(factor, "joint", getattr(factor, "link", 1))
            if joint > arm.n_joints:
                raise BadInput(
                    path, f"terms[{i}].basis", f"joint {joint}", f"a joint of 1…{arm.n_joints}"
                )
            for sensor in getattr(factor, "weights", {}):
                if sensor not in arm.sensors:
                    raise BadInput(
                        path,
                        f"terms[{i}].basis",
                        f"sensor {sensor!r}",
                        f"one of the arm's sensors {arm.sensors}",
                    )
