"""The common parts of all bridges: options, connection to the arm, start and end."""

from __future__ import annotations

import argparse
import asyncio
import os
import signal
import sys
import threading
from collections.abc import Awaitable, Callable
from contextlib import suppress
from functools import partial
from typing import Protocol, TypeVar, cast

import armd
from armd import Arm
from armd.printable import to_printable

#: Time limit for a connection: a daemon may be starting at the same time.
WAIT_S = 60.0
#: After this a message says that the process waits, and for what.
SAID_AFTER_S = 3.0
#: Limit of closing; Zenoh's close waits ten seconds for a peer that does not respond.
CLOSE_S = 1.0

T = TypeVar("T")


class SupportsClose(Protocol):
    def close(self) -> object: ...


ServeArm = Callable[[Arm], Awaitable[None]]
"""Serves one arm until it is cancelled."""


def report_ready(name: str, endpoint: str) -> None:
    """Print that the process is ready; whoever started it may use it now."""
    print(f"armd: ready {name} on {endpoint}", flush=True)


def warn(text: str) -> None:
    """Print a message on standard error, to explain why nothing happens."""
    print(to_printable(f"armd: {text}"), file=sys.stderr, flush=True)


def serve(args: argparse.Namespace, bridge: ServeArm) -> int:
    """Run *bridge* on the arm that *args* names until SIGTERM or SIGINT; return 0.

    Raises `ArmdError` if no such arm shows up within `WAIT_S`.
    """
    return _ended(asyncio.run(_until_told(lambda: _bridge(args, bridge))))


def serve_alone(work: Callable[[], Awaitable[None]]) -> int:
    """Run work that finds its arms itself until SIGTERM or SIGINT; return 0."""
    return _ended(asyncio.run(_until_told(work)))


def _ended(code: int) -> int:
    """Return the exit code, or exit at once if another thread still runs.

    That thread may be inside Zenoh, and an interpreter that shuts down meanwhile aborts the
    process.
    """
    if threading.active_count() > 1:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code


async def _until_told(work: Callable[[], Awaitable[None]]) -> int:
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    working = asyncio.ensure_future(work())
    waiting = asyncio.ensure_future(stop.wait())
    await asyncio.wait({working, waiting}, return_when=asyncio.FIRST_COMPLETED)
    waiting.cancel()
    if working.done():
        working.result()
    working.cancel()
    with suppress(asyncio.CancelledError):
        await working
    return 0


async def _bridge(args: argparse.Namespace, bridge: ServeArm) -> None:
    work = partial(armd.connect, args.serial, args.endpoint, WAIT_S)
    arm = await wait_for_connection(work, args.endpoint)
    try:
        await bridge(arm)
    finally:
        close_soon(arm)


async def wait_for_connection(work: Callable[[], T], endpoint: str) -> T:
    """Return the result of *work*, which connects within `WAIT_S`.

    After a while a message says which endpoint is awaited.
    """
    connecting = run_in_thread(work)
    await asyncio.wait({connecting}, timeout=SAID_AFTER_S)
    if not connecting.done():
        warn(f"{endpoint}: nobody answers yet; waiting for {WAIT_S:g} s at most")
    return await connecting


def close_soon(session: SupportsClose) -> None:
    """Close a session that may wait for its peers; wait for `CLOSE_S` at most."""
    closing = threading.Thread(target=session.close, daemon=True)
    closing.start()
    closing.join(CLOSE_S)


def run_in_thread(work: Callable[[], T]) -> asyncio.Future[T]:
    """Run blocking work in a thread that does not delay the process's end."""
    loop = asyncio.get_running_loop()
    future: asyncio.Future[T] = loop.create_future()

    def settle(result: T | None, error: BaseException | None) -> None:
        if future.done():  # cancelled meanwhile
            return
        if error is not None:
            future.set_exception(error)
        else:
            future.set_result(cast(T, result))

    def do() -> None:
        result, raised = None, None
        try:
            result = work()
        except Exception as error:
            raised = error
        with suppress(RuntimeError):  # the loop is closed: nobody waits any more
            loop.call_soon_threadsafe(settle, result, raised)

    threading.Thread(target=do, daemon=True).start()
    return future
