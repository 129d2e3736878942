"""Records the truth for tests: the true tip of each latch, and each fault."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, BinaryIO, TextIO

import numpy as np
import numpy.typing as npt

from armd.arrays import F64
from armd.simulator.live.faults import Fault

#: One latch in a truth file: seq as published (epoch << 32 | device seq), tip in the base frame.
TRUTH = np.dtype([("seq", "<u8"), ("position_mm", "<f8", (3,))])


class TruthFile:
    """The true tip of every latch, sent or not; *path* None: not recorded.

    Records of `TRUTH`, or, where the file's suffix is .jsonl, a line of JSON each.
    """

    def __init__(self, path: Path | None) -> None:
        self._file: BinaryIO | None = None if path is None else path.open("wb")
        self._lines = path is not None and path.suffix == ".jsonl"

    def append(self, seq: npt.NDArray[np.uint64], position_mm: F64) -> None:
        if self._file is None:
            return
        self._file.write(_lines(seq, position_mm) if self._lines else _records(seq, position_mm))
        self._file.flush()

    def close(self) -> None:
        if self._file is not None:
            self._file.close()


def _records(seq: npt.NDArray[np.uint64], position_mm: F64) -> bytes:
    rows = np.empty(len(seq), TRUTH)
    rows["seq"], rows["position_mm"] = seq, position_mm
    return rows.tobytes()


def _lines(seq: npt.NDArray[np.uint64], position_mm: F64) -> bytes:
    rows = zip(seq.tolist(), position_mm.tolist(), strict=True)
    return "".join(
        json.dumps({"seq": number, "position_mm": tip}) + "\n" for number, tip in rows
    ).encode()


class FaultLog:
    """JSON lines: every boot, every fault's begin and end, and every latch that was not sent.

    `{"event": "withheld", "reason": …, "first_seq": …, "last_seq": …}` names SAMPLEs that were
    never sent completely; all others of the truth file were. Standard error unless a path is given.
    """

    def __init__(self, path: Path | None) -> None:
        self._file: TextIO = sys.stderr if path is None else path.open("w", encoding="utf-8")
        self._reason = ""
        self._first = self._last = -1

    def write(self, event: str, **fields: Any) -> None:
        self._settle()
        self._line(event, fields)

    def begin(self, fault: Fault, **fields: Any) -> None:
        """Record the beginning of a fault."""
        detail = {"joint": fault.joint, "channel": fault.channel, "amount": fault.size}
        self.write("begin", fault=fault.name, **detail, **fields)

    def note_withheld(self, reason: str, first_seq: int, last_seq: int) -> None:
        """Record a run of latches, in order; successive runs become one line."""
        if reason == self._reason and first_seq == self._last + 1:
            self._last = last_seq
            return
        self._settle()
        self._reason, self._first, self._last = reason, first_seq, last_seq

    def close(self) -> None:
        self._settle()
        if self._file is not sys.stderr:
            self._file.close()

    def _settle(self) -> None:
        if self._reason:
            run = {"reason": self._reason, "first_seq": self._first, "last_seq": self._last}
            self._reason = ""
            self._line("withheld", run)

    def _line(self, event: str, fields: dict[str, Any]) -> None:
        print(json.dumps({"event": event, **fields}), file=self._file, flush=True)
