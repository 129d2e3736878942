"""Where each microsecond of a row goes in `armd correct` and `armd evaluate` of a Parquet file.

The commands' own functions, but in one thread, one piece after the other, with a clock read around
each stage. The commands run these beside each other: `BESIDE` says in which threads.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

from armd.compensation.data.correction import files as offline_files
from armd.compensation.data.correction.correction import Corrector
from armd.compensation.data.sessions import session
from armd.compensation.identify.evaluation import evaluate_files
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import LoadedCalibration

#: What each stage does, and the thread it runs in: `evaluate` does the first four twice.
BESIDE = {
    "read": "bytes from the file: reading thread",
    "decode": "Parquet to columns: reading thread",
    "check": "columns to checked states: reading thread; of `evaluate` the main one",
    "compute": "positions, uncertainties, flags, or distances: as many threads as processors",
    "encode": "columns to Parquet: writing thread",
    "write": "bytes to the file: writing thread",
}
BLOCK = 1 << 20


class _Clock:
    """Processor seconds by stage."""

    def __init__(self) -> None:
        self.used_s: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        began_s = time.process_time()
        yield
        self.used_s[name] = self.used_s.get(name, 0.0) + time.process_time() - began_s

    def timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*given: Any) -> Any:
            with self.stage(name):
                return function(*given)

        return call

    def pulled(self, name: str, pieces: Callable[..., Iterator[Any]]) -> Callable[..., Any]:
        """Where a call makes pieces one by one, each of them counts."""

        def call(*given: Any) -> Iterator[Any]:
            iterator = pieces(*given)
            following = self.timed(name, lambda: next(iterator, None))
            while (piece := following()) is not None:
                yield piece

        return call

    def in_turn(self, work: Callable[[Any], Any], pieces: Iterable[Any]) -> Iterator[Any]:
        return map(self.timed("compute", work), pieces)

    def us_a_row(self, rows: int, read_times: int, read_s: float) -> dict[str, float]:
        """µs by stage; what is in none of the others is `check`."""
        used_s = self.used_s
        others = [s for name, s in used_s.items() if name != "all"]
        used_s["check"] = used_s.pop("all") - sum(others)
        used_s["read"] = read_times * read_s
        used_s["decode"] -= used_s["read"]
        return {name: 1e6 * used_s[name] / rows for name in BESIDE if name in used_s}


def correct_stages(
    source: Path, arm: Arm, calibration: LoadedCalibration, target: Path, rows: int
) -> dict[str, float]:
    """µs of processor a row, by stage, of correcting *source* into *target*."""
    clock, corrector = _Clock(), Corrector(arm, calibration, "rad", None)
    with ExitStack() as patched:
        for name, stand_in in (
            ("map_in_order", clock.in_turn),
            ("read_ahead", iter),
            ("read_parquet_pieces", clock.pulled("decode", offline_files.read_parquet_pieces)),
            ("GroupWriter", _in_turn_writer(clock)),
        ):
            patched.enter_context(patch.object(offline_files, name, stand_in))
        with clock.stage("all"):
            offline_files.correct_file(source, target, corrector, lambda _: None)
    clock.used_s["write"] = write_s = _written_s(target)
    clock.used_s["encode"] -= write_s
    return clock.us_a_row(rows, 1, _read_s(source))


def evaluate_stages(
    folder: Path, arm: Arm, calibration: LoadedCalibration, rows: int
) -> dict[str, float]:
    """The same of evaluating the session *folder*."""
    clock = _Clock()
    with ExitStack() as patched:
        for module, name, stand_in in (
            (evaluate_files, "map_in_order", clock.in_turn),
            (session, "read_ahead", iter),
            (session, "read_pieces", clock.pulled("decode", session.read_pieces)),
        ):
            patched.enter_context(patch.object(module, name, stand_in))
        with clock.stage("all"):
            evaluate_files.evaluate_files([str(folder)], arm, calibration.content, lambda _: None)
    return clock.us_a_row(rows, 2, _read_s(folder / "readings.parquet"))


def table(stages: dict[str, dict[str, float]]) -> list[str]:
    """Lines: µs a row of each stage by command, and where it runs."""
    lines = [f"{'µs a row':10}" + "".join(f"{command:>10}" for command in stages)]
    for name, beside in BESIDE.items():
        cells = (f"{of[name]:10.3f}" if name in of else " " * 10 for of in stages.values())
        lines.append(f"{name:10}{''.join(cells)}  {beside}")
    together = "".join(f"{sum(of.values()):10.3f}" for of in stages.values())
    return [*lines, f"{'together':10}{together}"]


def _in_turn_writer(clock: _Clock) -> type[offline_files.GroupWriter]:
    class InTurn(offline_files.GroupWriter):
        """Writes a group at once, in the thread that asks for it."""

        def write(self, group: list[Any]) -> None:
            with clock.stage("encode"):
                super().write(group)
                super().wait()

    return InTurn


def _read_s(source: Path) -> float:
    began_s = time.process_time()
    with source.open("rb", buffering=0) as file:
        while file.read(BLOCK):
            pass
    return time.process_time() - began_s


def _written_s(target: Path) -> float:
    """Processor seconds of writing the bytes of *target* once more."""
    data = memoryview(target.read_bytes())
    again = target.with_suffix(".again")
    began_s = time.process_time()
    with again.open("wb", buffering=0) as file:
        for first in range(0, len(data), BLOCK):
            file.write(data[first : first + BLOCK])
    used_s = time.process_time() - began_s
    again.unlink()
    return used_s
