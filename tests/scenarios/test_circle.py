"""An arm with a hidden fault, over the wire: it fails, is diagnosed and mended, and passes."""

import pytest
from circle import Circle, closed


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
