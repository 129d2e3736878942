"""A command of its own: how long it took, what processor time, how much memory."""

from __future__ import annotations

import resource
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path


def measured(command: Sequence[str]) -> dict[str, float]:
    """Seconds from start to end, processor seconds of all cores, and the most MB resident."""
    began = time.perf_counter()
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    peak_kb = 0
    while child.poll() is None:  # what wait4 tells as its peak may be ours, before it was it
        with suppress(OSError, IndexError):
            status = Path(f"/proc/{child.pid}/status").read_text()
            peak_kb = max(peak_kb, int(status.split("VmHWM:")[1].split()[0]))
        time.sleep(0.01)
    if child.returncode:
        raise RuntimeError(f"{' '.join(command[1:4])} … ended with {child.returncode}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {
        "seconds": time.perf_counter() - began,
        "processor_s": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "peak_mb": 1.024e-3 * peak_kb,
    }
