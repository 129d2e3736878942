"""Drivers of other packages: their base, and the guard that keeps the daemon alive if one raises.

A package names its `DriverPlugin` by an entry point in the group `armd.drivers`; the entry point's
name is the `kind` of armd.toml (docs/developer/plugins.md).
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Collection
from typing import Any, TypeVar

import numpy as np

from armd.drivers.identity import Expectation
from armd.drivers.line_health import LineHealth
from armd.drivers.sample import Driver, Event, Item, RawFrame, Temperatures, sample_dtype
from armd.drivers.shell import Decoder
from armd.errors import ArmdError
from armd.files.schema import Strict
from armd.plugins.entry_points import Group, Plugin, load_all, load_named

GROUP: Group = "armd.drivers"
FAILED = "driver_failed"

_log = logging.getLogger(__name__)
T = TypeVar("T")


class DriverPlugin(Strict):
    """Base of a driver of another package: the keys of `[driver]` as fields, and two factories."""

    kind: str

    def make_driver(self, expectation: Expectation) -> Driver:
        """Make the driver with these keys, not open yet."""
        raise NotImplementedError

    def make_decoder(self, expectation: Expectation) -> Decoder | None:
        """Make a decoder for recordings of its raw frames; None: they cannot be replayed."""
        return None


def load_plugin_driver(kind: str, built_in: Collection[str]) -> type[DriverPlugin] | None:
    """Load the driver that a package provides for *kind*; None if none works."""
    return load_named(GROUP, kind, built_in, _checked)


def list_plugin_kinds(built_in: Collection[str]) -> list[str]:
    """List all kinds that packages provide."""
    return list(load_all(GROUP, built_in, _checked))


def _checked(plugin: Plugin, loaded: Any) -> type[DriverPlugin]:
    if not (isinstance(loaded, type) and issubclass(loaded, DriverPlugin)):
        expected = "a class that is based on armd.drivers.plugin.DriverPlugin"
        raise plugin.fault(repr(loaded), expected)
    return loaded


class GuardedDriver:
    """A driver of another package; see `armd.drivers.sample.Driver`.

    An exception that it raises becomes an event, and the driver is closed and opened again.
    """

    def __init__(self, config: DriverPlugin, expectation: Expectation) -> None:
        self._kind = config.kind
        try:
            self._driver = config.make_driver(expectation)
        except ArmdError:
            raise
        except Exception as error:
            raise ArmdError(f"driver {self._kind}: {_describe(error)}") from error
        self._dtype = sample_dtype(expectation.n_joints)
        self._n_sensors = expectation.n_sensors
        self._line = LineHealth(f"driver {config.kind}", 0)
        self._is_open = False
        self._logged: set[str] = set()

    @property
    def connected(self) -> bool:
        return self._is_open and self._ask(lambda: bool(self._driver.connected), False)

    @property
    def stale(self) -> bool:
        return not self._is_open or self._ask(lambda: bool(self._driver.stale), True)

    @property
    def hindrance(self) -> str:
        return self._ask(lambda: str(self._driver.hindrance), "")

    @property
    def counters(self) -> dict[str, int]:
        driver_counters: dict[str, int] = self._ask(
            lambda: {str(k): int(n) for k, n in self._driver.counters.items()}, {}
        )
        return driver_counters | {"reconnects": self._line.reconnects}

    def open(self) -> None:
        """Do nothing yet: `read` opens the driver, and tries again after a failure."""

    def close(self) -> None:
        if self._is_open:
            self._is_open = False
            self._ask(lambda: self._driver.close(), None)

    def read(self, timeout_s: float) -> list[Item]:
        now_ns = time.monotonic_ns()
        if not self._is_open and now_ns < self._line.open_due_ns:
            time.sleep(min(timeout_s, (self._line.open_due_ns - now_ns) / 1e9))
            return []
        try:
            if not self._is_open:
                self._driver.open()
                self._is_open = True
                self._line.opened(now_ns)
            items = list(self._driver.read(timeout_s))
            for item in items:
                self._check(item)
        except Exception as error:
            self._log(error)
            self.close()
            text = f"the driver {self._kind} failed and is opened again: {_describe(error)}"
            return self._line.lost(FAILED, text, time.monotonic_ns())
        return self._line.heard(None, items)

    def take_raw(self) -> list[RawFrame]:
        return self._ask(lambda: list(self._driver.take_raw()), [])

    def preamble(self) -> list[RawFrame]:
        return self._ask(lambda: list(self._driver.preamble()), [])

    def _check(self, item: object) -> None:
        """Raise `TypeError` for an item that the daemon cannot use."""
        match item:
            case np.ndarray() if item.dtype == self._dtype and item.ndim == 1:
                return
            case Temperatures() if np.shape(item.celsius) == (self._n_sensors,):
                return
            case Event():
                return
        expected = f"an Event, {self._n_sensors} Temperatures or an array of sample_dtype"
        raise TypeError(f"read gave {item!r:.100}, expected {expected}")

    def _ask(self, question: Callable[[], T], default: T) -> T:
        try:
            return question()
        except Exception as error:
            self._log(error)
            return default

    def _log(self, error: Exception) -> None:
        """Log each error once, with its traceback for the author of the driver."""
        if (text := _describe(error)) not in self._logged:
            self._logged.add(text)
            _log.warning("driver %s: %s", self._kind, text, exc_info=error)


def _describe(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
