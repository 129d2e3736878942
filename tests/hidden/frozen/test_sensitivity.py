"""Constants that decide are read from their table, varied, and their answers compared."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from hidden.frozen import sensitivity
from hidden.frozen.ablation import Answer, Task
from hidden.frozen.case import Cause, Truth, write_truth
from hidden.frozen.run import Ran
from hidden.frozen.sensitivity import count_rows, draw_cases, make_table, write_rows
from hidden.frozen.variations import list_deciding_constants, list_variations, vary

from armd.compensation.diagnose import constants

SCALE = {
    "cause": "encoder_scale", "location": "joint 3", "probability": 0.99, "depends_on": ["q3"],
}  # fmt: skip
RIGHT, NOTHING = Answer(Ran((SCALE,), 10.0, 6.0), {}), Answer(Ran((), 10.0, 10.0), {})


def test_the_table_has_what_decides_and_nothing_that_is_drawn() -> None:
    deciding = list_deciding_constants()
    assert deciding["ALPHA"] == constants.ALPHA and len(deciding) <= 60
    assert "SURE" not in deciding and "MOST_SEARCH_STEPS" not in deciding
    names = [rule.name for rule in list_variations()]
    assert names[:2] == ["ALPHA halved", "ALPHA doubled"] and len(set(names)) == len(names)


@pytest.mark.parametrize(
    ("value", "halved", "doubled"),
    [(0.01, 0.005, 0.02), (-40.0, -20.0, -80.0), (10, 5, 20), (1, 1, 2), (0.5, 0.25, 0.75),
     (0.8, 0.6, 0.9), (1.25, 1.125, 1.5), (1.0, 0.5, 2.0), (2.0, 1.0, 4.0),
     ((0.3, 100.0), (0.15, 50.0), (0.6, 200.0)), ({"mm": 1.0}, {"mm": 0.5}, {"mm": 2.0})],
)  # fmt: skip
def test_a_constant_is_halved_and_doubled(value: object, halved: object, doubled: object) -> None:
    for factor, expected in ((0.5, halved), (2.0, doubled)):
        varied = vary(value, factor)
        if isinstance(value, tuple | dict):
            assert varied == expected and type(varied) is type(value)
        else:
            assert varied == pytest.approx(expected) and type(varied) is type(value)


@pytest.fixture
def cases(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    monkeypatch.setattr(sensitivity, "CACHE", tmp_path)
    folders = [tmp_path / "421" / name for name in ("single-00", "single-01")]
    for folder in folders:
        folder.mkdir(parents=True)
        cause = Cause("encoder_scale", "joint 3", 12.0, variables=("q3",))
        write_truth(folder, Truth("single", 1, "encoder_scale joint 3 -6.5", (cause,)))
    return folders


def keep(path: Path, answer: Answer) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(asdict(answer)), encoding="utf-8")


def test_cases_are_those_in_which_a_rule_decides_and_clean_ones(
    cases: list[Path], tmp_path: Path
) -> None:
    """Short ones: the fourth takes too long."""
    keep(tmp_path / "answers" / "421-clean-00" / "all.json", NOTHING)
    slow = replace(NOTHING, ran=replace(NOTHING.ran, diagnose_s=60.0))
    keep(tmp_path / "answers" / "421-clean-01" / "all.json", slow)
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
