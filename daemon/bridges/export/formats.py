"""The formats of an export; the file's suffix chooses one."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from armd.daemon.bridges.export.qif import as_qif
from armd.daemon.bridges.export.source import MeasurementLine
from armd.daemon.bridges.export.tables import as_csv, as_ply, as_xyz
from armd.daemon.bridges.tips import Tips

#: Suffix → a test whether the first bytes are those of an earlier export in this format.
WRITTEN_BEFORE: dict[str, Callable[[bytes], bool]] = {
    ".csv": lambda head: head.startswith(b"stamp_ns,x_mm,y_mm,z_mm,"),
    ".xyz": lambda head: len(head.split(b"\n")[0].split()) == 6,
    ".ply": lambda head: head.startswith(b"ply\nformat ascii 1.0\ncomment measured points"),
    ".qif": lambda head: b"<QIFDocument" in head and b"<Name>armd " in head,
}


def as_text(suffix: str, measurements: Sequence[MeasurementLine], tips: Tips, serial: str) -> str:
    """Return the whole file as text; *suffix* is one of `WRITTEN_BEFORE`."""
    match suffix:
        case ".csv":
            return as_csv(measurements, tips)
        case ".xyz":
            return as_xyz(measurements, tips)
        case ".ply":
            return as_ply(measurements, tips)
        case _:
            return as_qif(measurements, tips, serial)
