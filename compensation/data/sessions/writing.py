"""Writes a session folder, as `load_session` reads it, whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy.typing as npt
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from armd.compensation.data.sessions.files import READINGS
from armd.compensation.data.sessions.format import SessionFile
from armd.files.toml_text import format_toml
from armd.files.writing import replace_file


def write_session(
    path: str | Path,
    file: Mapping[str, Any],
    columns: Mapping[str, npt.ArrayLike],
    *,
    parquet: bool = False,
) -> None:
    """Write a session folder that `load_session` reads; each of its files whole or not at all.

    *file* is the content of session.toml as plain data (`started` a datetime with its offset);
    *columns* maps the names of the contract to arrays or lists of n, NaN meaning missing.
    """
    SessionFile.model_validate(dict(file))
    folder = Path(path)
    folder.mkdir(parents=True, exist_ok=True)
    table = pa.table({name: pa.array(values) for name, values in columns.items()})
    with replace_file(folder / READINGS[parquet]) as part:
        if parquet:
            pa.parquet.write_table(table, part)
        else:
            pa.csv.write_csv(table, part)
    (folder / READINGS[not parquet]).unlink(missing_ok=True)
    with replace_file(folder / "session.toml") as part:
        part.write_text(format_toml(file), encoding="utf-8")
