"""A share of one processor for some processes, by a control group of the kernel's."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PERIOD_US = 10_000  # a tenth of the kernel's own: who has used up his share stands still so long
MOUNTS = Path("/proc/mounts")


class Unavailable(Exception):
    """This system lets us make no such group; the text says why."""


class Share:
    """This process and its children, but for those that are started `free`."""

    def __init__(self, group: Path) -> None:
        self._group = group
        self.free = ("sh", "-c", f'echo $$ >{group.parent}/cgroup.procs; exec "$@"', "sh")

    def stopped_percent(self) -> float:
        """Of the periods so far in which somebody ran, those in which the share was used up."""
        lines = (self._group / "cpu.stat").read_text().splitlines()
        count = {name: int(value) for name, value in map(str.split, lines)}
        return 100 * count["nr_throttled"] / max(count["nr_periods"], 1)


@contextmanager
def share_of_a_processor(share: float) -> Iterator[Share]:
    """While entered; raises `Unavailable`."""
    quota_us = str(int(share * PERIOD_US))
    root, unified = _mounted()
    group = root / f"armd-bench-{os.getpid()}"
    try:
        if unified:
            (root / "cgroup.subtree_control").write_text("+cpu")
        group.mkdir()
    except OSError as error:
        raise Unavailable(str(error)) from error
    try:
        if unified:
            (group / "cpu.max").write_text(f"{quota_us} {PERIOD_US}")
        else:
            (group / "cpu.cfs_period_us").write_text(str(PERIOD_US))
            (group / "cpu.cfs_quota_us").write_text(quota_us)
        (group / "cgroup.procs").write_text(str(os.getpid()))
        yield Share(group)
    finally:
        (root / "cgroup.procs").write_text(str(os.getpid()))
        group.rmdir()


def _mounted() -> tuple[Path, bool]:
    """Where groups with a share of the processor are made, and whether by cgroup's version 2."""
    for line in MOUNTS.read_text().splitlines():
        _, where, kind, options, *_ = line.split()
        if kind == "cgroup" and "cpu" in options.split(","):
            return Path(where), False
        if kind == "cgroup2" and "cpu" in (Path(where) / "cgroup.controllers").read_text().split():
            return Path(where), True
    raise Unavailable("found no control group for processors")
