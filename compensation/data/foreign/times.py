"""Reads the time of each row: seconds, Unix time, dates with times, times of a day."""

from __future__ import annotations

import datetime
import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from fractions import Fraction

from armd.compensation.data.foreign.cells import parse_number
from armd.compensation.data.foreign.table import ForeignTable
from armd.compensation.data.foreign.words import MISSING, TIMES
from armd.errors import BadInput

#: Unix time of September 2001 and of 2100, s: no elapsed time is so long.
EPOCH_S = (10**9, 4_102_444_800)
#: Units of Unix time, by the size of its numbers.
PARTS = {1: "s", 10**3: "ms", 10**6: "µs", 10**9: "ns"}
DAY_S = 86400
#: The description of times of a day, to which no date belongs.
OF_A_DAY = ", in times of a day: seconds since the first"
_CLOCK = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2}(?:[.,]\d{1,18})?))?\s*([ap]m)?", re.IGNORECASE)
_DAY_FIRST = re.compile(r"(\d{1,2})\.(\d{1,2})\.(\d{4})")
_SLASHES = re.compile(r"(\d{1,2})/(\d{1,2})/(\d{4})")


@dataclass(frozen=True)
class Times:
    """Seconds of each row, NaN if missing, since *started* if the table has dates."""

    seconds: list[float]
    started: datetime.datetime | None
    description: str


def read_times(
    table: ForeignTable, column: int, unit: str, day: int | None, since: datetime.datetime | None
) -> Times:
    """Read times from the cells of *column*, and dates from the column *day*, if there is one.

    *since* is the instant from which the seconds count if rows have dates; by default it is the
    earliest date. Raises `BadInput`.
    """
    cells = [row[column] for row in table.rows]
    if day is not None:
        dated = [
            f"{row[day]} {cell}" if row[day] and cell else cell
            for row, cell in zip(table.rows, cells, strict=True)
        ]
        if all(_CLOCK.fullmatch(cell) for cell in cells if cell.lower() not in MISSING):
            return _of_dates(table, column, dated, since)
    if any(parse_number(cell) is None for cell in cells):
        if all(_CLOCK.fullmatch(cell) for cell in cells if cell.lower() not in MISSING):
            return _of_clock(cells)
        return _of_dates(table, column, cells, since)
    return _of_numbers(table, column, cells, unit, since)


def _of_numbers(
    table: ForeignTable,
    column: int,
    cells: Sequence[str],
    unit: str,
    since: datetime.datetime | None,
) -> Times:
    try:
        exact = [None if cell.lower() in MISSING else Decimal(cell) for cell in cells]
    except InvalidOperation:
        exact = [None if cell.lower() in MISSING else Decimal(float(cell)) for cell in cells]
    for row, value in enumerate(exact):
        if value is not None and not value.is_finite():
            raise table.fault(row, column, "a finite number")
    values = [value for value in exact if value is not None]
    lowest, highest = min(values, default=Decimal(0)), max(values, default=Decimal(0))
    parts = [round(1 / TIMES[unit])] if unit and TIMES[unit] <= 1 else list(PARTS)
    if unit and TIMES[unit] > 1:
        parts = []
    for part in parts:
        if EPOCH_S[0] * part <= lowest and highest <= EPOCH_S[1] * part:
            instants = [None if value is None else Fraction(value) / part for value in exact]
            return _since(instants, since, f"in Unix time ({PARTS[part]})")
    factor = TIMES[unit or "s"]
    seconds = [float("nan") if value is None else factor * float(value) for value in exact]
    return Times(seconds, None, f", in {unit}" if factor != 1.0 else "")


def _of_dates(
    table: ForeignTable, column: int, cells: Sequence[str], since: datetime.datetime | None
) -> Times:
    instants: list[Fraction | None] = []
    zoned = False
    for row, cell in enumerate(cells):
        if cell.lower() in MISSING:
            instants.append(None)
            continue
        instant = _instant(cell)
        if instant is None:
            if _SLASHES.match(cell):
                raise table.fault(row, column, "a date as 2026-03-01: which of these is the month?")
            raise table.fault(row, column, "seconds, or a date and time as 2026-03-01 09:00:00")
        zoned = instant.tzinfo is not None
        instant = instant if zoned else instant.replace(tzinfo=datetime.UTC)
        since_1970 = instant - datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
        instants.append(Fraction(since_1970 // datetime.timedelta(microseconds=1), 10**6))
    return _since(instants, since, "in dates" if zoned else "in dates without a zone, taken as UTC")


def _instant(cell: str) -> datetime.datetime | None:
    """Return a date with a time of the day; None for anything else, or if it is ambiguous."""
    text = cell.strip().replace("/", "-") if re.match(r"\d{4}/", cell) else cell.strip()
    if ours := _DAY_FIRST.match(text):
        text = f"{ours[3]}-{int(ours[2]):02}-{int(ours[1]):02}{text[ours.end() :]}"
    elif slashes := _SLASHES.match(text):
        first, second = int(slashes[1]), int(slashes[2])
        if (first > 12) == (second > 12) and first != second:
            return None
        day, month = (first, second) if first > 12 else (second, first)
        text = f"{slashes[3]}-{month:02}-{day:02}{text[slashes.end() :]}"
    date, _, clock = re.sub(r"[T,]?\s+|T", " ", text, count=1).partition(" ")
    if (match := _CLOCK.match(clock.strip())) is not None and (clock := clock.strip()):
        seconds = Fraction((match[3] or "0").replace(",", "."))
        hour = int(match[1]) % 12 + 12 * (match[4].lower() == "pm") if match[4] else int(match[1])
        try:
            begin = datetime.datetime.fromisoformat(f"{date} 00:00{clock[match.end() :].strip()}")
        except ValueError:
            return None
        if hour > 23 or int(match[2]) > 59 or seconds >= 61:
            return None
        within = Fraction(3600 * hour + 60 * int(match[2])) + seconds
        return begin + datetime.timedelta(microseconds=round(within * 10**6))
    try:
        return datetime.datetime.fromisoformat(date if not clock else text)
    except ValueError:
        return None


def _of_clock(cells: Sequence[str]) -> Times:
    """Convert times of the day, which may pass midnight, to seconds since the first."""
    seconds: list[float] = []
    first: Fraction | None = None
    last, days = Fraction(0), 0
    for cell in cells:
        match = _CLOCK.fullmatch(cell)
        if match is None:
            seconds.append(float("nan"))
            continue
        hour = int(match[1]) % 12 + 12 * (match[4].lower() == "pm") if match[4] else int(match[1])
        now = 3600 * hour + 60 * int(match[2]) + Fraction((match[3] or "0").replace(",", "."))
        if now < last - DAY_S // 2:
            days += 1
        last = now
        first = now if first is None else first
        seconds.append(float(now + days * DAY_S - first))
    return Times(seconds, None, OF_A_DAY)


def _since(instants: Sequence[Fraction | None], since: datetime.datetime | None, how: str) -> Times:
    """Convert *instants* (Unix time) to seconds since *since*, or since the earliest of them."""
    given_instants = [instant for instant in instants if instant is not None]
    if not given_instants:
        return Times([float("nan")] * len(instants), None, "")
    epoch = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
    if since is None:
        first = min(given_instants)
        begin = epoch + datetime.timedelta(microseconds=int(first * 10**6))
    else:
        begin = since
    origin = Fraction((begin - epoch) // datetime.timedelta(microseconds=1), 10**6)
    seconds = [float("nan") if i is None else float(i - origin) for i in instants]
    return Times(seconds, begin, f", {how}")


def check_unit(table: ForeignTable, column: int, unit: str) -> None:
    """Raise `BadInput` for a unit that is no unit of time."""
    if unit and unit not in TIMES:
        location = f"column {table.header[column]}"
        raise BadInput(table.path, location, f"the unit {unit!r}", f"one of {', '.join(TIMES)}")
