"""Work on many pieces, on all processors, what comes of them in the order of the pieces."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar, cast

import numpy as np

#: What may stay free; glibc takes at most twice 32 MiB.
KEPT_BYTES = 62 << 20
Piece = TypeVar("Piece")
T = TypeVar("T")
_END = object()


def _processors() -> int:
    """That this process may use; all of them where the system does not tell (macOS, Windows)."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def keep_freed_memory() -> None:
    """Have the C library keep some memory for the next piece's arrays when a piece's are freed.

    glibc gives back what is free beyond twice the largest block that it ever gave back alone. That
    is little at first, and the system then hands out every page of every array anew, zeroed, which
    took a third of the time. Elsewhere this does nothing. Up to `KEPT_BYTES` stay with the process.
    """
    np.empty(KEPT_BYTES // 2, np.uint8)


def run_in_order(work: Callable[[Piece], T], pieces: Iterable[Piece]) -> Iterator[T]:
    """`map`, in threads: for work that mostly leaves the interpreter alone (numpy, Arrow, `jit`).

    Only a few pieces are taken before what comes of them is asked for, so that memory stays flat.
    """
    processors = _processors()
    if processors == 1:
        yield from map(work, pieces)
        return
    waiting: deque[Future[T]] = deque()
    with ThreadPoolExecutor(processors) as pool:
        try:
            for piece in pieces:
                waiting.append(pool.submit(work, piece))
                if len(waiting) > processors:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


def read_ahead(pieces: Iterable[Piece]) -> Iterator[Piece]:
    """The same pieces, the next of which is made in a thread while the last is worked on.

    What making one raises is raised in its place.
    """
    iterator = iter(pieces)

    def following() -> Piece | object:
        return next(iterator, _END)

    with ThreadPoolExecutor(1) as reader:
        coming = reader.submit(following)
        while (piece := coming.result()) is not _END:
            coming = reader.submit(following)
            yield cast(Piece, piece)
