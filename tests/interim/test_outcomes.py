"""The table of `make interim`: what it says of corrected measurements, on figures made up."""

from __future__ import annotations

import numpy as np
from drawn_changes import Case
from outcomes import Outcome, one_by_one, table

from armd.simulator.plants.plant import Plant


def an_outcome(artefact: str, uncorrected: float, error: float, oracle: float) -> Outcome:
    case = Case(1, Plant("tip_offset", "tip", 1.0, {}), 10.0, False, artefact, ())
    return Outcome(
        case, False, 1.0, 1.0, True, True, True, True, True, True, 0, True,
        error, oracle, uncorrected, 1.0, error, 9, None,
    )  # fmt: skip


def test_one_history_far_off_is_seen_beside_all_the_others() -> None:
    """Nine as good as the oracle, and one ten times as far off: the RMS is that of the one."""
    some = [an_outcome("bar", 5.0, 1.0, 1.0) for _ in range(9)]
    some.append(an_outcome("sphere", 8.0, 10.0, 1.0))
    found = dict(one_by_one(some))
    assert found["history by history: median ratio"] == "1.00"
    assert found["histories within 1.2 of the oracle"] == "9 of 10 (90 %)"
    assert found["histories made worse than uncorrected"] == "1 of 10 (10 %)"
    without = next(v for k, v in found.items() if k.startswith("ratio without the worst"))
    assert without == "1.00"
    assert (found["ratio on bar, of 9"], found["ratio on sphere, of 1"]) == ("1.00", "10.00")
    whole = float(np.sqrt((9 + 100) / 10))
    assert f"ratio {whole:.2f}" in table(some, (0, 0), (0, 0, 0))


def test_without_a_corrected_history_there_is_nothing_to_say() -> None:
    assert one_by_one([]) == []
    (median, within, *_) = one_by_one([an_outcome("bar", 2.0, 1.5, 1.0)])
    assert (median[1], within[1]) == ("1.50", "0 of 1 (0 %)")
