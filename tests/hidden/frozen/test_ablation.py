"""Rules of the diagnosis can be watched and switched off, and answers with and without compared."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from hidden.frozen import switches
from hidden.frozen.ablation import (
    Answer,
    Task,
    count_rows,
    draw_cases,
    judge,
    list_changes,
    make_table,
    write_rows,
)
from hidden.frozen.rules import RULES
from hidden.frozen.run import Ran
from hidden.frozen.switches import Rule, is_other

from support.frozen_case import SCALE, run_in_another_process, write_case

WITH = Ran((SCALE,), 10.0, 6.0)


@pytest.fixture
def case(tmp_path: Path) -> Path:
    return write_case(tmp_path / "421" / "single-00")


def test_every_rule_can_be_watched_and_switched_off() -> None:
    """In another process: what is switched off stays off."""
    code = (
        "from collections import Counter\n"
        "from hidden.frozen import ablation, switches\n"
        "from hidden.frozen.rules import RULES\n"
        "ablation._import_all()\n"
        "switches.watch(RULES, Counter())\n"
        "for rule in RULES: switches.switch_off(rule)\n"
        "from armd.compensation.diagnose.search import search, selection\n"
        "assert search.fit_with_growth('any') is None  # of the module that imports it\n"
        "assert selection.choose_shape('any') is None\n"
        "assert search.Search._revisited('search', 'current') == 'current'\n"
        "assert selection.MOST_RICHER == 0\n"
    )
    run_in_another_process(code)
    assert len({rule.name for rule in RULES}) == len(RULES)


def test_a_watched_function_gives_what_it_gave_and_is_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from armd.compensation.effects import twist

    original = twist.compute_outgoing
    monkeypatch.setattr(twist, "compute_outgoing", original)  # and back after the test
    counts: Counter[str] = Counter()
    at = "effects.twist:compute_outgoing"
    rule = Rule("turned", at, lambda _original, _alpha, _beta: None, here_only=True)
    switches.watch([rule], counts)
    assert twist.compute_outgoing(0.0, 0.0).tolist() == original(0.0, 0.0).tolist()
    assert counts == {"turned": 1}


def test_results_differ_by_value_where_they_have_one() -> None:
    kept = object()
    assert not is_other((kept, [1.0, "a"]), (kept, [1.0, "a"]))
    assert is_other((kept,), (object(),))
    assert is_other([kept], []) and is_other(True, False) and not is_other({}, {})


def test_an_answer_is_better_by_names_then_by_the_written_model(case: Path) -> None:
    nothing = replace(WITH, findings=(), after_um=10.0)
    wrong = replace(WITH, findings=(SCALE, SCALE | {"location": "joint 5"}))
    assert judge(case, WITH, nothing) == judge(case, WITH, wrong) == "+"
    assert judge(case, nothing, WITH) == "-"
    assert judge(case, WITH, replace(WITH, after_um=6.2)) == "+"
    assert judge(case, WITH, replace(WITH, after_um=6.1)) == "~"
    assert judge(case, WITH, WITH) == "="


def test_the_table_counts_what_was_run_without_a_rule(case: Path) -> None:
    rule = Rule("shapes")
    with_all = {case: Answer(WITH, {"shapes": 3})}
    assert draw_cases(rule, with_all, 5) == [case]
    assert draw_cases(Rule("others"), with_all, 5) == []
    without = {Task(case, "shapes", case): Answer(replace(WITH, after_um=7.0), {})}
    rows = count_rows([rule], with_all, without)
    head, row = make_table(rows)
    assert head.split()[1:] == ["changed", "run", "other", "better", "worse"]
    assert row.split() == ["shapes", "1", "1", "1", "1", "0"]
    assert list_changes(with_all, without)[0] == "+ shapes: 421 single-00"


def test_a_rule_that_is_gone_keeps_its_row(tmp_path: Path) -> None:
    table, row = tmp_path / "rules.csv", dict.fromkeys(("changed", "run", "other", "better"), 3)
    write_rows(table, {"gone": row | {"worse": 1}, RULES[0].name: row | {"worse": 0}})
    write_rows(table, {RULES[0].name: row | {"worse": 2}})
    head, *lines = table.read_text(encoding="utf-8").splitlines()
    assert head == "rule,changed,run,other,better,worse,kept"
    assert lines == ["gone,3,3,3,3,1,no", f"{RULES[0].name},3,3,3,3,2,yes"]
