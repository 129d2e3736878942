"""A Zenoh session with a daemon or a router, and the search for an arm there."""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import zenoh

from armd import keys
from armd.errors import ArmdError, BadInput, Closed, NoAnswer

ENDPOINT = "tcp/127.0.0.1:7447"
MOST_RECEIVED_BYTES = 32 << 20  # the answer with the largest calibration file

_log = logging.getLogger(__name__)


def open_session(endpoint: str = ENDPOINT, timeout_s: float = 10.0) -> zenoh.Session:
    """Open a Zenoh session with a daemon or a router, for a program with many arms.

    Raises `ArmdError` if none answers there.
    """
    settings = _settings(endpoint, timeout_s)
    _log.info("connecting to %s", endpoint)
    try:
        session = zenoh.open(settings)
    except zenoh.ZError as error:
        _log.info("Zenoh: %s", error)
        # Zenoh's own text names files of its sources, which do not help in a traceback.
        raise NoAnswer(
            f"{endpoint}: no daemon answers within {timeout_s:g} s: is it running (armd run"
            " armd.toml), and does it listen there? (armd demo prints its endpoint)"
        ) from None
    _log.info("connected to %s", endpoint)
    return session


@contextmanager
def convert_errors(session: zenoh.Session, key: str) -> Iterator[None]:
    """Convert an error of Zenoh's to `Closed`, or an `ArmdError` naming *key*, within this `with`.

    Zenoh's own text ends with a file of its sources, which is cut off.
    """
    closed = "the connection to the arm is closed"
    if session.is_closed():
        raise Closed(closed)
    try:
        yield
    except zenoh.ZError as error:
        if session.is_closed():
            raise Closed(closed) from None
        reason = str(error).splitlines()[0].partition(" at /")[0][:200]
        raise ArmdError(f"{key}: Zenoh refuses it: {reason}") from None


def _settings(endpoint: str, timeout_s: float) -> zenoh.Config:
    if "://" in endpoint:
        expected = endpoint.replace("://", "/").rstrip("/")
        raise ArmdError(f"endpoint: found {endpoint!r}, expected it as Zenoh has it: {expected}")
    if "/" not in endpoint and not endpoint.endswith(".json5"):
        raise ArmdError(f"endpoint: found {endpoint!r}, expected its protocol too: tcp/{endpoint}")
    protocol, _, address = endpoint.partition("/")
    if protocol in ("tcp", "tls", "quic", "udp", "ws") and ":" not in address:
        raise ArmdError(f"endpoint: found {endpoint!r}, expected its port too: {endpoint}:7447")
    settings: dict[str, Any] = {
        "connect/timeout_ms": round(timeout_s * 1000),
        "transport/link/rx/max_message_size": MOST_RECEIVED_BYTES,
    }
    if endpoint.endswith(".json5"):
        try:
            config = zenoh.Config.from_file(endpoint)
        except (zenoh.ZError, OSError) as error:
            problem = "nothing" if not Path(endpoint).exists() else str(error).splitlines()[0][:200]
            expected = "a Zenoh configuration (JSON5)"
            raise BadInput(endpoint, "the file", problem, expected) from None
    else:
        config = zenoh.Config()
        settings |= {
            "mode": "client",
            "connect/endpoints": [endpoint],
            "scouting/multicast/enabled": False,
        }
    try:
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
    except zenoh.ZError:
        expected = "PROTOCOL/ADDRESS, or a Zenoh configuration file (*.json5)"
        raise ArmdError(f"endpoint: found {endpoint!r}, expected {expected}") from None
    return config


def find_arm(session: zenoh.Session, serial: str | None, endpoint: str, timeout_s: float) -> str:
    """Return the serial number of the only arm, or of the one named; raises `ArmdError`."""
    end_s = time.monotonic() + timeout_s
    while True:
        serials = _serials(session, serial or "*")
        if len(serials) == 1:
            _log.info("arm %s is there", *serials)
            return serials.pop()
        if serials:
            raise ArmdError(f"{endpoint}: several arms, name one: {', '.join(sorted(serials))}")
        if time.monotonic() > end_s:
            if serial is None:
                raise NoAnswer(f"{endpoint}: no arm within {timeout_s:g} s")
            serials_present = sorted(_serials(session, "*"))
            presence = (
                f"there is {', '.join(serials_present)}" if serials_present else "nor any other"
            )
            raise NoAnswer(f"{endpoint}: no arm {serial} within {timeout_s:g} s; {presence}")
        time.sleep(0.1)


def _serials(session: zenoh.Session, serial: str) -> set[str]:
    """Return the serial numbers of the arms that are present; "*" asks for all."""
    key = keys.key(serial, keys.ALIVE)
    with convert_errors(session, key):
        replies = list(session.liveliness().get(key))
    return {str(reply.ok.key_expr).split("/")[1] for reply in replies if reply.ok is not None}
