"""Processes many pieces on all processors and returns the results in the order of the pieces."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar, cast

import numpy as np

#: Freed memory that the process may keep; glibc takes at most twice 32 MiB.
KEPT_BYTES = 62 << 20
Piece = TypeVar("Piece")
T = TypeVar("T")
_END = object()


def _processors() -> int:
    """Return the number of processors of this process; all if it is unknown (macOS, Windows)."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def keep_freed_memory() -> None:
    """Let the C library keep a piece's freed memory for the next piece's arrays.

    glibc returns free memory beyond twice the largest block that it ever returned alone. That is
    little at first, and the system then supplies every page of every array anew, zeroed, which took
    a third of the time. On other systems this does nothing. Up to `KEPT_BYTES` stay with the
    process.
    """
    np.empty(KEPT_BYTES // 2, np.uint8)


def run_in_order(work: Callable[[Piece], T], pieces: Iterable[Piece]) -> Iterator[T]:
    """Map *work* over *pieces* in threads, for work that releases the interpreter (numpy, Arrow,
    `jit`).

    Only a few pieces are taken before their results are requested, so that memory stays constant.
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
    """Yield the pieces, each of which is made in a thread while the one before is processed.

    An exception in making a piece is raised in its place.
    """
    iterator = iter(pieces)

    def following() -> Piece | object:
        return next(iterator, _END)

    with ThreadPoolExecutor(1) as reader:
        coming = reader.submit(following)
        while (piece := coming.result()) is not _END:
            coming = reader.submit(following)
            yield cast(Piece, piece)
