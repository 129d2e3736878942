"""Checks after which no change was told, as far as watching goes on from them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Quiet:
    """What came of the first checks, after none of which a change was told: all that watching the
    later ones needs of it."""

    statistic: tuple[float, ...] = ()  # after each of them
    bad: tuple[int, ...] = ()  # those of them that will not be doubted again


NOTHING_YET = Quiet()
