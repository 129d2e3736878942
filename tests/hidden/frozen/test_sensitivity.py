"""Constants that decide are read from their table, varied, and their answers compared."""

from __future__ import annotations

import csv
import json
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from hidden.frozen import sensitivity
from hidden.frozen.ablation import Answer, Task
from hidden.frozen.freeze import ROOT
from hidden.frozen.run import Ran
from hidden.frozen.sensitivity import count_rows, draw_cases, make_table, write_rows
from hidden.frozen.variations import NOT_VARIED, list_constants, list_variations, vary

from armd.compensation.diagnose import constants
from support.frozen_case import SCALE, run_in_another_process, write_case

RIGHT, NOTHING = Answer(Ran((SCALE,), 10.0, 6.0), {}), Answer(Ran((), 10.0, 10.0), {})


def test_the_table_has_what_decides_and_nothing_that_is_drawn() -> None:
    varied = {constant.name: constant for constant in list_constants()}
    assert varied["ALPHA"].value == constants.ALPHA and varied["ALPHA"].unit == "1"
    assert varied["LEAST_UNEVEN"].unit == "noise units over all readings"
    assert {"SURE", "MOST_SEARCH_STEPS", *NOT_VARIED}.isdisjoint(varied)
    names = [rule.name for rule in list_variations()]
    assert names[:2] == ["ALPHA halved", "ALPHA doubled"] and len(set(names)) == len(names)


def test_every_constant_that_decides_has_its_row() -> None:
    with (ROOT / "docs/developer/constants.csv").open(encoding="utf-8", newline="") as file:
        rows = {row["constant"]: row["value"] for row in csv.DictReader(file)}
    assert rows == {constant.name: str(constant.value) for constant in list_constants()}


@pytest.mark.parametrize(
    ("value", "unit", "halved", "doubled"),
    [(0.01, "1", 0.005, 0.02), (-40.0, "nat", -20.0, -80.0), (10, "causes", 5, 20),
     (1, "rests", 1, 2), (0.5, "1", 0.25, 0.75), (0.5, "noise units", 0.25, 1.0),
     (0.8, "1", 0.6, 0.9), (1.25, "1", 1.125, 1.5), (1.0, "σ", 0.5, 2.0), (2.0, "1", 1.0, 4.0),
     ((0.3, 100.0), "1", (0.6, 50.0), (0.15, 200.0)),
     ({"mm": 1.0}, "mm", {"mm": 0.5}, {"mm": 2.0})],
)  # fmt: skip
def test_a_constant_is_halved_and_doubled(
    value: object, unit: str, halved: object, doubled: object
) -> None:
    for factor, expected in ((0.5, halved), (2.0, doubled)):
        varied = vary(value, factor, unit)
        if isinstance(value, dict):
            assert varied == expected
        else:
            assert varied == pytest.approx(expected)
        assert type(varied) is type(value)


def test_every_constant_is_read_where_it_is_set() -> None:
    """In another process: a value that something was made of at import would change nothing."""
    code = (
        "import sys\n"
        "from hidden.frozen import ablation, switches\n"
        "from hidden.frozen.variations import list_variations\n"
        "ablation._import_all()\n"
        "modules = [m for m in switches._list_modules() if m.__name__ != switches.CONSTANTS]\n"
        "for rule in list(list_variations()):\n"
        "    ((name, value),) = rule.values.items()\n"
        "    before = getattr(sys.modules[switches.CONSTANTS], name)\n"
        "    having = [m for m in modules if vars(m).get(name) is before]\n"
        "    switches.switch_off(rule)\n"
        "    assert having and all(vars(m)[name] is value for m in having), name\n"
        "    assert all('.diagnose.' in m.__name__ for m in having), name  # no other's constant\n"
    )
    run_in_another_process(code)


@pytest.fixture
def cases(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    monkeypatch.setattr(sensitivity, "CACHE", tmp_path)
    return [write_case(tmp_path / "421" / name) for name in ("single-00", "single-01")]


def keep(path: Path, answer: Answer) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(asdict(answer)), encoding="utf-8")


def test_cases_are_those_in_which_a_rule_decides_and_clean_ones(
    cases: list[Path], tmp_path: Path
) -> None:
    """Short ones, that were not refused."""
    keep(tmp_path / "answers" / "421-clean-00" / "all.json", NOTHING)
    slow = replace(NOTHING, ran=replace(NOTHING.ran, diagnose_s=60.0))
    keep(tmp_path / "answers" / "421-clean-01" / "all.json", slow)
    refused = replace(NOTHING, ran=Ran(refused="no calibration"))
    keep(tmp_path / "answers" / "421-clean-02" / "all.json", refused)
    for name, without in (("single-00", NOTHING), ("single-01", RIGHT)):
        keep(tmp_path / "answers" / f"421-{name}" / "all.json", RIGHT)
        keep(tmp_path / "answers" / f"421-{name}" / "a-shape-as-a-finding.json", without)
        keep(tmp_path / "answers" / f"421-{name}" / "ALPHA-halved.json", NOTHING)  # is no rule
    clean = tmp_path / "421" / "clean-00"
    assert draw_cases(tmp_path / "answers", ["421"], 8) == [cases[0], clean]
    assert draw_cases(tmp_path / "answers", ["422"], 8) == []


def test_a_value_that_names_less_is_counted_as_worse(cases: list[Path], tmp_path: Path) -> None:
    as_it_is = {cases[0]: RIGHT, cases[1]: NOTHING}
    task = Task(cases[0], "ALPHA halved", tmp_path)
    varied = {
        task: NOTHING, replace(task, case=cases[1]): RIGHT,
        replace(task, rule="ALPHA doubled"): RIGHT,
        replace(task, rule="ALPHA doubled", case=cases[1]): NOTHING,
    }  # fmt: skip
    (row,) = rows = count_rows(["ALPHA"], as_it_is, varied)
    assert row == {
        "constant": "ALPHA", "value": 0.01, "halved_other": 2, "halved_better": 1,
        "halved_worse": 1, "doubled_other": 0, "doubled_better": 0, "doubled_worse": 0, "cases": 2,
    }  # fmt: skip
    write_rows(tmp_path / "constants.csv", rows)
    header, line = (tmp_path / "constants.csv").read_text(encoding="utf-8").splitlines()
    assert line == "ALPHA,0.01,2,1,1,0,0,0,2" and header.count(",") == line.count(",")
    assert [len(text.split()) for text in make_table(rows)] == [9, 9]
