"""Memory that was freed and is kept for later: back to the system, between stages of much work."""

import ctypes


def give_back_freed() -> None:
    """What the C library keeps of freed memory, where it is one that can be asked (glibc).

    It takes arrays of up to 32 MB from one heap, which shrinks at its end only: a small object that
    stays there keeps all that was freed below it, of a calibration of 20 000 readings 700 MB.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
