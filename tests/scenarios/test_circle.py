"""An arm with a hidden fault, over the wire: it fails, is diagnosed and mended, and passes."""

import pytest
from circle import CAUSE, LOCATION, Circle, closed


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_circle_closes(tmp_path, monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    figures = Circle(tmp_path, 5).run()
    assert closed(figures), figures
    assert figures["diagnosis"]["probability"] > 0.9
    # What was wrong is mended, not merely below the limit.
    assert figures["after"]["SPAT max δ"] < figures["before"]["SPAT max δ"] / 3
    # The twin errs by as much as the arm does, in other postures.
    assert 0.5 < figures["twin"]["SPAT max δ"] / figures["before"]["SPAT max δ"] < 2.0


def test_a_circle_that_is_open_anywhere_is_not_closed():
    figures = {
        "before": {"code": 1}, "after": {"code": 0}, "twin": {"code": 1},
        "diagnosis": {"cause": CAUSE, "location": LOCATION}, "beam": {"twin": 20.5, "arm": 20.0},
    }  # fmt: skip
    assert closed(figures)
    wrong = {
        "before": {"code": 0},
        "after": {"code": 1},
        "twin": {"code": 0},
        "diagnosis": {"cause": CAUSE, "location": "elsewhere"},
        "beam": {"twin": 21.5, "arm": 20.0},
    }
    assert [closed(figures | {name: value}) for name, value in wrong.items()] == [False] * 5
