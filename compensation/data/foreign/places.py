"""Which column of a foreign table is which of a session's: by name, by number, by content."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from armd.compensation.data.foreign.cells import number
from armd.compensation.data.foreign.table import ForeignTable
from armd.compensation.data.foreign.words import (
    DATE,
    NAMED_JOINTS,
    TEMPERATURE,
    TEMPERATURES,
    TIMES,
    WORDS,
    Kind,
    joint_name,
    numbered,
    without_temperature,
    word_and_unit,
)
from armd.compensation.model.arm import Arm
from armd.errors import BadInput
from armd.terminal.suggest import few, hint

TEXTS = ("placement", "target")
_ROS_NAME, _ROS_POSITION = re.compile(r"(.*)name_?(\d+)"), "{}position{}"


@dataclass
class Places:
    """A session's column → its number in the table, from 0; and what was assumed for it."""

    table: ForeignTable
    arm: Arm
    known: Sequence[str]
    at: dict[str, int] = field(default_factory=dict)
    day: int | None = None  # a column of dates, beside one of times of a day
    said: list[str] = field(default_factory=list)

    def free(self) -> list[tuple[int, str]]:
        """Columns that are nothing yet: number and header."""
        taken = {*self.at.values(), self.day}
        return [(at, h) for at, h in enumerate(self.table.header) if h and at not in taken]

    def put(self, name: str, at: int) -> None:
        """Raises `BadInput` where another column is *name* already."""
        if name in self.at:
            header = self.table.header
            both = f"two columns, {header[self.at[name]]!r} and {header[at]!r}"
            expected = f"--column {name}=HEADER"
            if joint_name(header[self.at[name]]) == joint_name(header[at]):
                expected += ", or --prefix NAME for one arm of several (left_)"
            raise BadInput(self.table.path, name, both, expected)
        self.at[name] = at


def find_places(
    table: ForeignTable,
    arm: Arm,
    given: Mapping[str, str],
    known: Sequence[str],
    targets: Sequence[str],
) -> Places:
    """*given*: a session's column → the table's, as the person said; *targets*: the artefact's.

    Raises `BadInput` for what may be two things.
    """
    places = Places(table, arm, known)
    for name, header in given.items():
        if name not in known:
            raise BadInput("the command line", "--column", name, f"a column{hint(name, known)}")
        if header not in table.header:
            expected = f"a column of the table{hint(header, table.header)}"
            raise BadInput(table.path, "--column", repr(header), expected)
        at = table.header.index(header)
        if at in places.at.values():
            both = next(other for other, place in places.at.items() if place == at)
            found = f"{header!r} as {both} and as {name}"
            raise BadInput("the command line", "--column", found, "each column once")
        places.at[name] = at
    for kind in ("angle", "rate", "temperature"):
        _put_numbered(places, kind, given)
    _put_words(places, given)
    _put_named_joints(places)
    _put_bare_t(places)
    _put_only_temperature(places)
    _put_day(places)
    _put_target_by_content(places, targets)
    places.at = {name: places.at[name] for name in known if name in places.at}
    return places


def _put_numbered(places: Places, kind: Kind, given: Mapping[str, str]) -> None:
    """Columns such as `Joint 1`; those of one family, where one is number 0, count from 0."""
    families: dict[str, dict[int, int]] = defaultdict(dict)
    for at, header in places.free():
        if kind == "temperature" and _sensor_by_name(places.arm, header):
            continue
        said = numbered(word_and_unit(header)[0])
        if said and said.kind == kind and said.number not in families[said.family]:
            families[said.family][said.number] = at
        elif said and said.kind == kind:
            number_0 = families[said.family][said.number]
            both = f"{places.table.header[number_0]!r} and {header!r}"
            raise BadInput(places.table.path, "the header", f"two columns, {both}", "one of them")
    letter = {"angle": "q", "rate": "w"}
    for family in filter(None, families.values()):
        if kind == "temperature":
            _put_sensors(places, family, given)
            continue
        first = 0 if 0 in family else 1
        used = [k for k in family if k - first < places.arm.n_joints]
        for k in used:
            name = f"{letter[kind]}{k - first + 1}"
            if name not in given:
                places.put(name, family[k])
        if first == 0 and used:
            header = places.table.header[family[0]]
            places.said.append(f"columns like {header!r} count from 0: it is {letter[kind]}1")


def _put_sensors(places: Places, family: Mapping[int, int], given: Mapping[str, str]) -> None:
    """Columns of temperatures that count, as sensors: by the number in both names, or in order."""
    sensors = places.arm.sensors
    numbers = [re.findall(r"\d+", name) for name in sensors]
    by_number: dict[int, list[str]] = defaultdict(list)
    for name, found in zip(sensors, numbers, strict=True):
        for text in found[-1:]:
            by_number[int(text)].append(name)
    if not by_number:
        _put_sensors_in_order(places, family, given)
        return
    if len(family) >= len(sensors) and not set(by_number) <= set(family):
        headers = few(places.table.header[at] for at in family.values())
        expected = f"the numbers of {few(sensors)}, or which is which: --column {sensors[0]}=HEADER"
        raise BadInput(places.table.path, "the temperatures", headers, expected)
    for k, at in family.items():
        names = by_number.get(k, [])
        header = places.table.header[at]
        if len(names) > 1:
            both = f"{few(names)} for {header!r}"
            raise BadInput(places.table.path, "the sensors", both, f"--column {names[0]}=HEADER")
        if 0 in family and 0 not in by_number:
            expected = f"numbers as in {few(sensors)}: --column {sensors[0]}=HEADER"
            raise BadInput(places.table.path, f"column {header}", "numbers from 0", expected)
        if names and names[0] not in given:
            places.put(names[0], at)


def _put_sensors_in_order(
    places: Places, family: Mapping[int, int], given: Mapping[str, str]
) -> None:
    sensors = places.arm.sensors
    first = 0 if 0 in family else 1
    within = [k for k in family if 0 <= k - first < len(sensors)]
    if within and len(within) < len(family):
        headers = few(places.table.header[at] for at in family.values())
        expected = f"which is which: --column {sensors[0]}=HEADER (the arm has {few(sensors)})"
        raise BadInput(places.table.path, "the temperatures", headers, expected)
    for k in within:
        if sensors[k - first] not in given:
            places.put(sensors[k - first], family[k])


def _sensor_by_name(arm: Arm, header: str) -> str | None:
    """The sensor called *header*, with a word for temperature or without."""
    word = word_and_unit(header)[0]
    by_word = {word_and_unit(name)[0]: name for name in arm.sensors}
    by_word |= {re.sub(r"[^a-zäöü0-9]", "", name.lower()): name for name in arm.sensors}
    return header if header in arm.sensors else by_word.get(
        word, by_word.get(without_temperature(word))
    )  # fmt: skip


def _put_words(places: Places, given: Mapping[str, str]) -> None:
    """Columns that are called what they are."""
    for at, header in places.free():
        word, _ = word_and_unit(header)
        meant = header if header in places.known and not re.fullmatch(r"[qw]\d+", header) else None
        meant = meant or _sensor_by_name(places.arm, header) or _as_word(word)
        if meant is None or meant in given or word == "t":
            continue
        if meant in places.at and places.table.header[places.at[meant]] == meant:
            continue  # `placement` and `pose`: the one that has the session's own name
        places.put(meant, at)


def _as_word(word: str) -> str | None:
    return {"artefactc": "artefact_c"}.get(word, WORDS.get(word))


def _put_named_joints(places: Places) -> None:
    """Joints that have names, in the header or in cells, where all of a known arm are there."""
    if any(f"q{k}" in places.at for k in range(1, places.arm.n_joints + 1)):
        return
    columns: dict[str, list[int]] = defaultdict(list)
    named = _named_in_cells(places.table)
    for at, header in places.free():
        columns[joint_name(named.get(header, header))].append(at)
    for names in NAMED_JOINTS:
        if len(names) == places.arm.n_joints and all(columns[name] for name in names):
            for k, name in enumerate(names, 1):
                for at in columns[name]:
                    places.put(f"q{k}", at)
            return


def _put_bare_t(places: Places) -> None:
    """`T` alone is time or temperature: by its unit, else by what the table lacks."""
    bare = [(at, header) for at, header in places.free() if word_and_unit(header)[0] == "t"]
    for at, header in sorted(bare, key=lambda one: not _is_clock(places.table, one[0])):
        unit = word_and_unit(header)[1]
        sensors = [name for name in places.arm.sensors if name not in places.at]
        only_time = not places.arm.sensors and header == "t"
        only_time = only_time or bool(places.arm.sensors and not sensors)
        if unit in TIMES or (not unit and "time_s" not in places.at and only_time):
            places.put("time_s", at)
        elif unit in TEMPERATURES or "time_s" in places.at:
            if len(sensors) == 1:
                places.put(sensors[0], at)
            # else: reported as temperatures without a sensor
        elif not unit and _is_clock(places.table, at):
            places.put("time_s", at)
        elif not unit:
            other = sensors[0] if sensors else "artefact_c"
            expected = f"which: --column time_s={header}, or --column {other}={header}"
            found = "a name that may mean time or temperature"
            raise BadInput(places.table.path, f"column {header}", found, expected)


def _is_clock(table: ForeignTable, at: int) -> bool:
    """Whether a column has dates, or begins with zero and rises: no temperature does."""
    values = [number(row[at]) for row in table.rows]
    if any(value is None for value in values):
        return True
    numbers = [value for value in values if value is not None]
    rising = all(b > a for a, b in pairwise(numbers))
    return rising and len(numbers) > 1 and (numbers[0] == 0.0 or numbers[0] > 1e8)


def _put_only_temperature(places: Places) -> None:
    """A column `Temperature`, where one sensor alone has no column."""
    words = TEMPERATURE[1:]
    here = [at for at, header in places.free() if word_and_unit(header)[0] in words]
    sensors = [name for name in places.arm.sensors if name not in places.at]
    if len(here) == len(sensors) == 1 and len(places.arm.sensors) == 1:
        places.put(sensors[0], here[0])


def _put_day(places: Places) -> None:
    """A column of dates, beside one of times or alone."""
    days = [at for at, header in places.free() if word_and_unit(header)[0] in DATE]
    if len(days) != 1:
        return
    if "time_s" in places.at:
        places.day = days[0]
    else:
        places.put("time_s", days[0])


def _put_target_by_content(places: Places, targets: Sequence[str]) -> None:
    """The one column whose cells are all names of the artefact's targets."""
    if "target" in places.at or not targets:
        return
    fitting = [
        at
        for at, _ in places.free()
        if all(row[at] in targets for row in places.table.rows)
    ]  # fmt: skip
    if len(fitting) == 1:
        places.put("target", fitting[0])


def without_joint(places: Places, k: int) -> BadInput:
    """No column is joint *k*; where the names are in cells, as ROS writes them, it says which."""
    table = places.table
    expected = f"a column for joint {k}: --column q{k}=HEADER"
    pairs = [f"{value} is {name}" for value, name in _named_in_cells(table).items()]
    if pairs:
        expected += f" ({few(pairs)}, by the names in the table)"
    return BadInput(table.path, f"q{k}", f"no such column among {few(table.header)}", expected)


def _named_in_cells(table: ForeignTable) -> dict[str, str]:
    """Header of a position → its joint's name, as ROS writes it in a column beside it, where that
    is the same in every row."""
    found = {}
    for at, header in enumerate(table.header):
        like = _ROS_NAME.fullmatch(header)
        value = _ROS_POSITION.format(like[1], like[2]) if like else ""
        if value in table.header and len({row[at] for row in table.rows}) == 1:
            found[value] = table.rows[0][at]
    return found
