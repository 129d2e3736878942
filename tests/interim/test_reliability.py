"""Probabilities that `armd interim` tells hold, of changes drawn as it expects them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bench import Bench
from reliability import expectation, months, told
from threadpoolctl import threadpool_limits

from armd.compensation.interim.told import tomorrow


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
def test_what_is_told_comes_as_often_as_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The cause that is named, and that it is wrong after one more check, the usual or the proposed
    one. Three standard deviations either way are what luck may do."""
    monkeypatch.setattr(tomorrow, "LEFT", np.inf)  # worth proposing or not
    pairs = []
    with threadpool_limits(limits=1):
        bench = Bench(7041, tmp_path / "arm")
        every = months(bench, 7041)
        for number in range(60):
            rng = np.random.default_rng([7041, 0x2E1, number])
            pairs += told(bench, every[number % len(every)], rng, proposed=True)
    for what in ("cause", "wrong after the usual check", "wrong after the proposed check"):
        own = [pair for pair in pairs if pair.what == what]
        expected, spread = expectation(own)
        came = sum(pair.came for pair in own)
        assert len(own) >= 3, what
        assert abs(came - expected) <= 3.0 * spread + 0.5, (what, came, expected, spread)
