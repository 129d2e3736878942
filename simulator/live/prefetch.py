"""Work done ahead of its time in a process of its own, so that deadlines are kept in this one."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from typing import Generic, TypeVar

T = TypeVar("T")

#: After an item, before the next: whoever has just taken one is busy with it.
REST_S = 0.1


class Prefetch(Generic[T]):
    """An iterator whose items another process computes, as far ahead as the pipe holds (64 kB), ten
    a second at most.

    Close it; the other process also ends when this one dies, because its pipe breaks.
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
    receive.close()  # else the pipe would never break
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the other process's business
    os.nice(5)  # being ahead, it can wait
    try:
        for item in items:
            send.send(item)
            time.sleep(REST_S)
    except BrokenPipeError:
        pass
