"""Format numbers, angles and moments as a person in a workshop writes them."""

from __future__ import annotations

import datetime

import numpy as np

ARC_SECOND = np.pi / 180.0 / 3600.0


def format_plain(value: float, digits: int = 2, sign: str = "") -> str:
    """Format a number with so many digits, whole ones in full, without an exponent."""
    size = abs(value)
    decimals = digits - 1 - int(np.floor(np.log10(size))) if size > 1e-9 else 0
    return f"{value:{sign}.{max(decimals, 0)}f}"


def format_clock(unix_s: float) -> str:
    """Format a moment to the second, in UTC."""
    moment = datetime.datetime.fromtimestamp(unix_s, datetime.UTC)
    return f"{moment:%Y-%m-%d %H:%M:%S} UTC"


def seconds_of_arc(angle_rad: float) -> str:
    """Format an angle in seconds of arc."""
    seconds = abs(angle_rad) / ARC_SECOND
    return f"{format_plain(seconds)}″"


def format_minute(unix_s: float) -> str:
    """Format a moment to the minute, in UTC."""
    return f"{datetime.datetime.fromtimestamp(unix_s, datetime.UTC):%Y-%m-%d %H:%M} UTC"
