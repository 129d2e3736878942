"""Computes work in advance in another process, so that this one keeps its deadlines."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from typing import Generic, TypeVar

T = TypeVar("T")

#: Pause after an item, because its receiver is busy with it.
REST_S = 0.1


class Prefetch(Generic[T]):
    """An iterator whose items another process computes in advance, at most ten a second.

    It is ahead by as much as the pipe holds (64 kB). Close it; the other process also ends when
    this one dies, because its pipe breaks.
    """

    def __init__(self, items: Iterator[T]) -> None:
        context = multiprocessing.get_context("fork")  # the iterator need not be picklable
        self._receive, send = context.Pipe(duplex=False)
        self._process = context.Process(
            target=_produce, args=(items, send, self._receive), daemon=True
        )
        self._process.start()
        send.close()

    def __iter__(self) -> Iterator[T]:
        return self

    def __next__(self) -> T:
        try:
            item: T = self._receive.recv()
        except EOFError:
            raise StopIteration from None
        return item

    def close(self) -> None:
        self._receive.close()
        self._process.join()


def _produce(items: Iterator[T], send: Connection, receive: Connection) -> None:
    receive.close()  # otherwise the pipe would never break
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the other process handles Ctrl-C
    os.nice(5)  # it is ahead and can wait
    try:
        for item in items:
            send.send(item)
            time.sleep(REST_S)
    except BrokenPipeError:
        pass
