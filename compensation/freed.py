"""Memory that was freed and is kept for later: back to the system, between stages of much work; and
how often Python looks for what could be freed."""

import ctypes
import gc
from collections.abc import Iterator
from contextlib import contextmanager

#: New objects between two looks at the newest, and of these looks between two at the older ones.
#: With Python's 700 and 10 a diagnosis of 2000 readings spent 0.3 s of 5 on three looks at
#: everything, of 20,000 0.7 of 29 on five, and 0.1 while modules are imported; with these there is
#: none, for 50 MB more of 0.5 GB, and none more of 1.7.
SELDOM = (10_000, 20, 20)


def drop_freed() -> None:
    """What the C library keeps of freed memory, where it is one that can be asked (glibc).

    It takes arrays of up to 32 MB from one heap, which shrinks at its end only: a small object that
    stays there keeps all that was freed below it, of a calibration of 20 000 readings 700 MB.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


@contextmanager
def collect_seldom() -> Iterator[None]:
    """Python looks for unreachable objects seldom: for work that makes many which stay.

    What is no cycle is freed at once as ever.
    """
    before = gc.get_threshold()
    gc.set_threshold(*SELDOM)
    try:
        yield
    finally:
        gc.set_threshold(*before)
