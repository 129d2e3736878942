"""Memory that was freed below something that stays goes back to the system; looks are seldom."""

import gc
import platform
import subprocess
import sys

import pytest

from armd.compensation.freed import collect_seldom

#: Once a large array was freed, glibc takes all up to its size from the heap.
HEAP = """
import os
import numpy as np
from armd.compensation.freed import drop_freed

def resident_mb():
    with open("/proc/self/statm") as statm:
        return int(statm.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6

del (large := [np.ones(3_500_000)])[:]
blocks = [np.ones(size) for _ in range(50) for size in (500_000, 100_000)]
freed, above = blocks[::2], blocks[1::2]  # no older hole holds so many
del blocks, freed
before = resident_mb()
drop_freed()
print(before - resident_mb(), sum(one.sum() for one in above))
"""


@pytest.mark.slow
def test_what_was_freed_goes_back_and_what_stays_is_untouched() -> None:
    if platform.libc_ver()[0] != "glibc":
        pytest.skip("no C library that can be asked")
    told = subprocess.run(
        [sys.executable, "-c", HEAP], check=True, capture_output=True, text=True
    ).stdout.split()
    assert float(told[0]) > 150.0
    assert float(told[1]) == 50 * 100_000.0


def test_python_looks_for_what_could_be_freed_seldom_and_then_as_before() -> None:
    before = gc.get_threshold()
    looks = [0]
    gc.callbacks.append(look := lambda phase, _: looks.append(looks.pop() + (phase == "start")))
    try:
        often = _looks_at_cycles(looks)
        with pytest.raises(ZeroDivisionError), collect_seldom():
            seldom = _looks_at_cycles(looks)
            1 / 0  # noqa: B018
    finally:
        gc.callbacks.remove(look)
    assert gc.get_threshold() == before
    assert 0 < seldom < often / 5


def _looks_at_cycles(looks: list[int]) -> int:
    """How often Python looked while 100,000 objects were made."""
    start, kept = looks[0], []
    for _ in range(100_000):
        kept.append([kept])
    return looks[0] - start
