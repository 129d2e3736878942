"""Finds the column of a foreign table for each column of a session: by name, number or content."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from armd.compensation.data.foreign.cells import parse_number
from armd.compensation.data.foreign.table import ForeignTable
from armd.compensation.data.foreign.words import (
    DATE,
    NAMED_JOINTS,
    TEMPERATURE,
    TEMPERATURES,
    TIMES,
    WORDS,
    Kind,
    drop_temperature,
    find_joint_name,
    parse_numbered,
    split_unit,
)
from armd.compensation.model.arm import Arm
from armd.errors import BadInput
from armd.terminal.suggest import format_names, suggest_names

TEXTS = ("placement", "target")
_ROS_NAME, _ROS_POSITION = re.compile(r"(.*)name_?(\d+)"), "{}position{}"


@dataclass
class Places:
    """The numbers of a session's columns in the table, from 0, and the assumptions made."""

    table: ForeignTable
    arm: Arm
    column_names: Sequence[str]
    column_of: dict[str, int] = field(default_factory=dict)
    day: int | None = None  # a column of dates, if times of a day have another
    remarks: list[str] = field(default_factory=list)

    def free(self) -> list[tuple[int, str]]:
        """Return the number and header of the columns that have no meaning yet."""
        used = {*self.column_of.values(), self.day}
        return [
            (column, h) for column, h in enumerate(self.table.header) if h and column not in used
        ]

    def put(self, name: str, column: int) -> None:
        """Assign a column; raises `BadInput` if another column is *name* already."""
        if name in self.column_of:
            header = self.table.header
            actual = f"two columns, {header[self.column_of[name]]!r} and {header[column]!r}"
            expected = f"--column {name}=HEADER"
            if find_joint_name(header[self.column_of[name]]) == find_joint_name(header[column]):
                expected += ", or --prefix NAME for one arm of several (left_)"
            raise BadInput(self.table.path, name, actual, expected)
        self.column_of[name] = column


def find_places(
    table: ForeignTable,
    arm: Arm,
    assigned: Mapping[str, str],
    names: Sequence[str],
    targets: Sequence[str],
) -> Places:
    """Find the places of all columns.

    *assigned* maps a session's columns to the table's, as the user stated; *targets* are the
    artefact's. Raises `BadInput` for an ambiguous column.
    """
    places = Places(table, arm, names)
    for name, header in assigned.items():
        if name not in names:
            raise BadInput(
                "the command line", "--column", name, f"a column{suggest_names(name, names)}"
            )
        if header not in table.header:
            expected = f"a column of the table{suggest_names(header, table.header)}"
            raise BadInput(table.path, "--column", repr(header), expected)
        column = table.header.index(header)
        if column in places.column_of.values():
            name_before = next(
                column_name for column_name, place in places.column_of.items() if place == column
            )
            actual = f"{header!r} as {name_before} and as {name}"
            raise BadInput("the command line", "--column", actual, "each column once")
        places.column_of[name] = column
    for kind in ("angle", "rate", "temperature"):
        _put_numbered(places, kind, assigned)
    _put_words(places, assigned)
    _put_named_joints(places)
    _put_bare_t(places)
    _put_only_temperature(places)
    _put_day(places)
    _put_target_by_content(places, targets)
    places.column_of = {name: places.column_of[name] for name in names if name in places.column_of}
    return places


def _put_numbered(places: Places, kind: Kind, assigned: Mapping[str, str]) -> None:
    """Assign columns such as `Joint 1`; a family with a number 0 counts from 0."""
    families: dict[str, dict[int, int]] = defaultdict(dict)
    for column, header in places.free():
        if kind == "temperature" and _sensor_by_name(places.arm, header):
            continue
        match = parse_numbered(split_unit(header)[0])
        if match and match.kind == kind and match.number not in families[match.family]:
            families[match.family][match.number] = column
        elif match and match.kind == kind:
            number_0 = families[match.family][match.number]
            actual = f"{places.table.header[number_0]!r} and {header!r}"
            raise BadInput(places.table.path, "the header", f"two columns, {actual}", "one of them")
    letter = {"angle": "q", "rate": "w"}
    for family in filter(None, families.values()):
        if kind == "temperature":
            _put_sensors(places, family, assigned)
            continue
        first = 0 if 0 in family else 1
        used = [k for k in family if k - first < places.arm.n_joints]
        for k in used:
            name = f"{letter[kind]}{k - first + 1}"
            if name not in assigned:
                places.put(name, family[k])
        if first == 0 and used:
            header = places.table.header[family[0]]
            places.remarks.append(f"columns like {header!r} count from 0: it is {letter[kind]}1")


def _put_sensors(places: Places, family: Mapping[int, int], assigned: Mapping[str, str]) -> None:
    """Assign numbered columns of temperatures to sensors: by the number in both names, or
    in order.
    """
    sensors = places.arm.sensors
    numbers = [re.findall(r"\d+", name) for name in sensors]
    by_number: dict[int, list[str]] = defaultdict(list)
    for name, digits in zip(sensors, numbers, strict=True):
        for text in digits[-1:]:
            by_number[int(text)].append(name)
    if not by_number:
        _put_sensors_in_order(places, family, assigned)
        return
    if len(family) >= len(sensors) and not set(by_number) <= set(family):
        headers = format_names(places.table.header[column] for column in family.values())
        expected = (
            f"the numbers of {format_names(sensors)}, or which is which:"
            f" --column {sensors[0]}=HEADER"
        )
        raise BadInput(places.table.path, "the temperatures", headers, expected)
    for k, column in family.items():
        names = by_number.get(k, [])
        header = places.table.header[column]
        if len(names) > 1:
            actual = f"{format_names(names)} for {header!r}"
            raise BadInput(places.table.path, "the sensors", actual, f"--column {names[0]}=HEADER")
        if 0 in family and 0 not in by_number:
            expected = f"numbers as in {format_names(sensors)}: --column {sensors[0]}=HEADER"
            raise BadInput(places.table.path, f"column {header}", "numbers from 0", expected)
        if names and names[0] not in assigned:
            places.put(names[0], column)


def _put_sensors_in_order(
    places: Places, family: Mapping[int, int], assigned: Mapping[str, str]
) -> None:
    sensors = places.arm.sensors
    first = 0 if 0 in family else 1
    within = [k for k in family if 0 <= k - first < len(sensors)]
    if within and len(within) < len(family):
        headers = format_names(places.table.header[column] for column in family.values())
        expected = (
            f"which is which: --column {sensors[0]}=HEADER (the arm has {format_names(sensors)})"
        )
        raise BadInput(places.table.path, "the temperatures", headers, expected)
    for k in within:
        if sensors[k - first] not in assigned:
            places.put(sensors[k - first], family[k])


def _sensor_by_name(arm: Arm, header: str) -> str | None:
    """Return the sensor called *header*, with or without a word for temperature."""
    word = split_unit(header)[0]
    by_word = {split_unit(name)[0]: name for name in arm.sensors}
    by_word |= {re.sub(r"[^a-zäöü0-9]", "", name.lower()): name for name in arm.sensors}
    return header if header in arm.sensors else by_word.get(
        word, by_word.get(drop_temperature(word))
    )  # fmt: skip


def _put_words(places: Places, assigned: Mapping[str, str]) -> None:
    """Assign columns by their own names."""
    for column, header in places.free():
        word, _ = split_unit(header)
        name = (
            header
            if header in places.column_names and not re.fullmatch(r"[qw]\d+", header)
            else None
        )
        name = name or _sensor_by_name(places.arm, header) or _as_word(word)
        if name is None or name in assigned or word == "t":
            continue
        if name in places.column_of and places.table.header[places.column_of[name]] == name:
            continue  # of `placement` and `pose` keep the session's own name
        places.put(name, column)


def _as_word(word: str) -> str | None:
    return {"artefactc": "artefact_c"}.get(word, WORDS.get(word))


def _put_named_joints(places: Places) -> None:
    """Assign joints with names, in the header or in cells, if all of a known arm are present."""
    if any(f"q{k}" in places.column_of for k in range(1, places.arm.n_joints + 1)):
        return
    columns: dict[str, list[int]] = defaultdict(list)
    named = _named_in_cells(places.table)
    for column, header in places.free():
        columns[find_joint_name(named.get(header, header))].append(column)
    for names in NAMED_JOINTS:
        if len(names) == places.arm.n_joints and all(columns[name] for name in names):
            for k, name in enumerate(names, 1):
                for column in columns[name]:
                    places.put(f"q{k}", column)
            return


def _put_bare_t(places: Places) -> None:
    """Assign a column `T` to time or temperature: by its unit, else by what the table lacks."""
    bare = [(column, header) for column, header in places.free() if split_unit(header)[0] == "t"]
    for column, header in sorted(
        bare, key=lambda candidate: not _is_clock(places.table, candidate[0])
    ):
        unit = split_unit(header)[1]
        sensors = [name for name in places.arm.sensors if name not in places.column_of]
        only_time = not places.arm.sensors and header == "t"
        only_time = only_time or bool(places.arm.sensors and not sensors)
        if unit in TIMES or (not unit and "time_s" not in places.column_of and only_time):
            places.put("time_s", column)
        elif unit in TEMPERATURES or "time_s" in places.column_of:
            if len(sensors) == 1:
                places.put(sensors[0], column)
            # else: a remark reports it as a temperature without a sensor
        elif not unit and _is_clock(places.table, column):
            places.put("time_s", column)
        elif not unit:
            sensor = sensors[0] if sensors else "artefact_c"
            expected = f"which: --column time_s={header}, or --column {sensor}={header}"
            actual = "a name that may mean time or temperature"
            raise BadInput(places.table.path, f"column {header}", actual, expected)


def _is_clock(table: ForeignTable, column: int) -> bool:
    """Return whether a column has dates, or starts at zero and rises, unlike temperatures.

    Rising numbers that start above 1e8 (Unix time) count, too.
    """
    values = [parse_number(row[column]) for row in table.rows]
    if any(value is None for value in values):
        return True
    numbers = [value for value in values if value is not None]
    rising = all(b > a for a, b in pairwise(numbers))
    return rising and len(numbers) > 1 and (numbers[0] == 0.0 or numbers[0] > 1e8)


def _put_only_temperature(places: Places) -> None:
    """Assign a column `Temperature` to the arm's only sensor, if that has no column."""
    words = TEMPERATURE[1:]
    candidates = [column for column, header in places.free() if split_unit(header)[0] in words]
    sensors = [name for name in places.arm.sensors if name not in places.column_of]
    if len(candidates) == len(sensors) == 1 and len(places.arm.sensors) == 1:
        places.put(sensors[0], candidates[0])


def _put_day(places: Places) -> None:
    """Assign a single column of dates, in addition to times or alone."""
    days = [column for column, header in places.free() if split_unit(header)[0] in DATE]
    if len(days) != 1:
        return
    if "time_s" in places.column_of:
        places.day = days[0]
    else:
        places.put("time_s", days[0])


def _put_target_by_content(places: Places, targets: Sequence[str]) -> None:
    """Assign the one column whose cells are all names of the artefact's targets."""
    if "target" in places.column_of or not targets:
        return
    fitting = [
        column
        for column, _ in places.free()
        if all(row[column] in targets for row in places.table.rows)
    ]  # fmt: skip
    if len(fitting) == 1:
        places.put("target", fitting[0])


def refuse_missing_joint(places: Places, k: int) -> BadInput:
    """Return the error of a missing column for joint *k*, with the names that ROS wrote
    into cells.
    """
    table = places.table
    expected = f"a column for joint {k}: --column q{k}=HEADER"
    pairs = [f"{value} is {name}" for value, name in _named_in_cells(table).items()]
    if pairs:
        expected += f" ({format_names(pairs)}, by the names in the table)"
    return BadInput(
        table.path, f"q{k}", f"no such column among {format_names(table.header)}", expected
    )


def _named_in_cells(table: ForeignTable) -> dict[str, str]:
    """Map the header of a position to its joint's name, as ROS writes it in a column beside it.

    Names that differ between rows are ignored.
    """
    joint_names = {}
    for column, header in enumerate(table.header):
        like = _ROS_NAME.fullmatch(header)
        value = _ROS_POSITION.format(like[1], like[2]) if like else ""
        if value in table.header and len({row[column] for row in table.rows}) == 1:
            joint_names[value] = table.rows[0][column]
    return joint_names
