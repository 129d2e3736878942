"""What a set of findings must show to take another's place."""

from __future__ import annotations

import math

import pytest

from armd.compensation.diagnose.constants import BEYOND_CHANCE, CONTRADICTED
from armd.compensation.diagnose.search.replacing import compute_heldout_margin
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, tie
from armd.compensation.model.slow_factors import After
from support.small_fit import candidate

GAIN, DISC, SLIP, NAMELESS = (candidate(cause, 2) for cause in ("gain", "disc", "slip", "unknown"))
STEPS = [tie([("theta_2", 1.0)], After(instant_unix_s=at)) for at in (0.0, 3600.0, 7200.0)]
BY_SESSION = Candidate(
    "geometry_shift",
    location.joint(2),
    tuple(Column(f"theta, {i}", "rad", 1.0, steps) for i, steps in enumerate(STEPS)),
    ("time_s",),
)
CLEARLY = math.log(10.0)


@pytest.mark.parametrize(
    ("findings", "instead_of"), [([GAIN, DISC], [GAIN, NAMELESS]), ([DISC, NAMELESS], [GAIN, SLIP])]
)
def test_a_likelier_set_counts_unless_it_is_contradicted(
    findings: list[Candidate], instead_of: list[Candidate]
) -> None:
    assert compute_heldout_margin(findings, instead_of, CLEARLY + 0.1) == -CONTRADICTED
    assert compute_heldout_margin(findings, instead_of, CLEARLY - 0.1) is None


def test_causes_that_say_why_take_the_place_of_a_value_for_each_session() -> None:
    """Evidence within ten nats decides nothing there: readings held out do."""
    causes = [SLIP, candidate("thermal", 2)]
    assert compute_heldout_margin(causes, [BY_SESSION], CLEARLY + 0.1) == -CONTRADICTED
    assert compute_heldout_margin(causes, [BY_SESSION], -9.0) == BEYOND_CHANCE > 0.0
    assert compute_heldout_margin(causes, [BY_SESSION], -11.0) is None
    assert compute_heldout_margin([BY_SESSION], [SLIP], -9.0) is None
