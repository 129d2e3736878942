"""The file of a reduced check: JSON that a person can read, one row of numbers a line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from pydantic import Field, ValidationError

from armd.arrays import F64
from armd.compensation.interim.checks.reduced import Reduced
from armd.files.schema import Strict, parse_json

DIGITS = 7


class StatisticsFile(Strict):
    """The content of statistics.json; rows are whitened: their noise has a variance of 1."""

    schema_: str = Field(alias="schema", pattern="^armd.interim.statistics/1$")
    readings: int
    rms_um: float
    mean_unix_s: float
    first_unix_s: float
    last_unix_s: float
    catalogue: str = ""  # empty in files of versions that did not write it
    temperature_c: dict[str, tuple[float, float]] = {}
    residual: list[float]
    cause_columns: int
    causes: list[list[float]]
    known_names: list[str]
    error_columns: list[list[float]] = Field(alias="known")
    target_names: list[str]
    certified: list[bool]
    targets: list[list[float]]


def to_json(reduced: Reduced) -> str:
    """Return the text of the file."""
    head = {
        "schema": "armd.interim.statistics/1",
        "readings": reduced.readings,
        "rms_um": reduced.rms_um,
        "mean_unix_s": reduced.mean_unix_s,
        "first_unix_s": reduced.first_unix_s,
        "last_unix_s": reduced.last_unix_s,
        "catalogue": reduced.catalogue,
        "temperature_c": reduced.temperature_c,
        "residual": _to_numbers(reduced.residual),
        "cause_columns": reduced.causes.shape[1],
        "known_names": list(reduced.known_names),
        "target_names": list(reduced.target_names),
        "certified": list(reduced.certified),
    }
    lines = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in head.items()]
    matrices = {
        "causes": reduced.causes,
        "known": reduced.error_columns,
        "targets": reduced.targets,
    }
    for name, matrix in matrices.items():
        rows = [json.dumps(_to_numbers(row)) for row in matrix]
        lines.append(f"{json.dumps(name)}: [\n" + ",\n".join(rows) + "\n]")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def from_json(path: Path, content: bytes) -> Reduced:
    """Read a reduced check from the content of a file; raises `BadInput`."""
    try:
        # A history has a file for each day: the slower parser, which explains a fault, runs only if
        # there is one.
        file = StatisticsFile.model_validate_json(content, strict=True)
    except ValidationError:
        file = parse_json(path, content, StatisticsFile)
    r = len(file.residual)
    return Reduced(
        residual=np.array(file.residual),
        causes=np.array(file.causes).reshape(r, file.cause_columns),
        error_columns=np.array(file.error_columns).reshape(r, len(file.known_names)),
        known_names=tuple(file.known_names),
        targets=np.array(file.targets).reshape(r, 3 * len(file.target_names)),
        target_names=tuple(file.target_names),
        certified=tuple(file.certified),
        mean_unix_s=file.mean_unix_s,
        first_unix_s=file.first_unix_s,
        last_unix_s=file.last_unix_s,
        readings=file.readings,
        rms_um=file.rms_um,
        catalogue=file.catalogue,
        temperature_c=file.temperature_c,
    )


def _to_numbers(values: F64) -> list[float]:
    return [float(f"{value:.{DIGITS}g}") for value in values]
