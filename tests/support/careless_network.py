"""A Zenoh network where everybody may speak, and sound messages of an arm to put on it."""

from __future__ import annotations

import json
from contextlib import closing, contextmanager
from typing import Any

import numpy as np
import zenoh

import armd
from armd.client import Arm
from armd.daemon.bridges.fleet import Fleet
from support.running_daemon import free_endpoint

HEALTH = {
    "state": "READY", "reason": "it measures", "stamp_ns": 1, "uptime_s": 2.0,
    "rates": {"points_hz": 500.0}, "drops": {"lost": 0}, "last_second": {"flagged": {}},
    "temperatures": {"t1": 20.5, "t2": None}, "calibration": None, "tip": None,
}  # fmt: skip
MEASUREMENT = {
    "seq": 1, "stamp_ns": 1, "position_mm": [1.0, 2.0, 3.0], "orientation": [0, 0, 0, 1],
    "approach": None, "covariance_mm2": None, "standard_deviation_mm": None, "count": 1,
    "flags": 0, "flag_names": [], "buttons": 1, "calibration": None, "tip": None,
}  # fmt: skip
EVENT = {"kind": "button", "text": "button 0 pressed", "stamp_ns": 1, "detail": {"buttons": [0]}}


def fleet_of(health: dict[str, Any]) -> Fleet:
    """What `armd fleet` knows of an arm that is there and said this of its health."""
    fleet = Fleet()
    fleet.note_token("S", True)
    fleet.note_health("S", health)
    return fleet


@contextmanager
def session(mode, endpoint, **more):
    """Closed by `close`: Zenoh's own `with` fails ("Already borrowed") while a thread of its own,
    which a callback runs in, asks the session something."""
    config = zenoh.Config()
    settings = {"mode": mode, "scouting/multicast/enabled": False, "timestamping/enabled": True}
    settings["connect/endpoints" if mode == "client" else "listen/endpoints"] = [endpoint]
    for key, value in (settings | more).items():
        config.insert_json5(key, json.dumps(value))
    with closing(zenoh.open(config)) as opened:
        yield opened


@contextmanager
def careless_network():
    """A hub that lets everybody speak, a publisher behind it, somebody else, and an `Arm`."""
    endpoint = free_endpoint()
    with (
        session("router", endpoint),
        session("client", endpoint) as publisher,
        session("client", endpoint) as other,
        session("client", endpoint) as own,
    ):
        yield publisher, other, Arm(own, "SIM-0001")


def points(first, n=1):
    array = np.zeros(n, armd.POINT)
    array["seq"] = np.arange(first, first + n)
    return [row.tobytes() for row in array]
