"""The sources of a session's readings: a folder, or a table in memory."""

from __future__ import annotations

import hashlib
import io
import shutil
from pathlib import Path
from typing import Any, Protocol

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from armd.compensation.data.sessions.columns import list_number_columns
from armd.compensation.data.sessions.files import READINGS, check_is_session, find_readings
from armd.compensation.data.sessions.format import SessionFile
from armd.compensation.data.sessions.session import TEXTS, assemble_session, check_arm, load_session
from armd.compensation.data.sessions.session import Session as StoredSession
from armd.compensation.data.sessions.writing import write_session
from armd.compensation.data.tables.header import check_header
from armd.compensation.data.tables.readings import (
    MISSING,
    Readings,
    convert_columns,
    refuse_empty,
    select_columns,
)
from armd.compensation.model.arm import Arm
from armd.files.schema import load_toml
from armd.files.toml_text import format_toml


class SessionSource(Protocol):
    """The source of a session's readings."""

    path: Path | None
    file: SessionFile

    def load(self, arm: Arm, place: Path) -> StoredSession: ...
    def readings(self) -> pa.Table: ...
    def save(self, folder: Path) -> None: ...


class FolderSource:
    """A session in a folder."""

    def __init__(self, folder: Path) -> None:
        check_is_session(folder)
        self.path: Path | None = folder
        self._folder = folder
        self.file = load_toml(folder / "session.toml", SessionFile)
        self._table = find_readings(folder)

    def load(self, arm: Arm, place: Path) -> StoredSession:
        return load_session(place, arm, self.file)

    def readings(self) -> pa.Table:
        if self._table.suffix != ".csv":
            return pa.parquet.read_table(self._table)
        options = pa.csv.ConvertOptions(null_values=list(MISSING), strings_can_be_null=False)
        return pa.csv.read_csv(self._table, convert_options=options)

    def save(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("session.toml", self._table.name):
            if not (folder / name).exists() or not (folder / name).samefile(self._folder / name):
                shutil.copyfile(self._folder / name, folder / name)


class TableSource:
    """A session from a table in memory."""

    path: Path | None = None

    def __init__(self, file: SessionFile, table: pa.Table) -> None:
        self.file = file
        self._table = table

    def load(self, arm: Arm, place: Path) -> StoredSession:
        check_arm(place, self.file, arm)
        header = list(self._table.column_names)
        check_header(place, header)
        columns = select_columns(header, list_number_columns(arm), TEXTS)
        table = convert_columns(place, self._table, columns)
        if table.num_rows == 0:
            raise refuse_empty(place)
        readings = Readings(place, header, table)
        return assemble_session(place, self.file, arm, readings, digest=self._digest)

    def readings(self) -> pa.Table:
        return self._table

    def save(self, folder: Path) -> None:
        columns = {name: self._table[name] for name in self._table.column_names}
        write_session(folder, self._content(), columns)

    def _content(self) -> dict[str, Any]:
        content = self.file.model_dump(by_alias=True, exclude_none=True, exclude_defaults=True)
        return content | {"angle_unit": self.file.angle_unit, "artefact": self._artefact()}

    def _artefact(self) -> dict[str, Any]:
        return self.file.artefact.model_dump(
            by_alias=True, exclude_none=True, exclude_defaults=True
        )

    def _digest(self) -> str:
        """Return the hash that the folder of `save` would have."""
        text = io.BytesIO()
        pa.csv.write_csv(self._table, text)
        digest = hashlib.sha256()
        toml = format_toml(self._content()).encode()
        for name, data in (("session.toml", toml), (READINGS[0], text.getvalue())):
            digest.update(f"{name}\0{len(data)}\0".encode())
            digest.update(data)
        return digest.hexdigest()
