"""What a set of findings must show to take another's place."""

from __future__ import annotations

import math

import pytest

from armd.compensation.diagnose.constants import BEYOND_CHANCE, CONTRADICTED, REPLACING_SIGMAS
from armd.compensation.diagnose.search.replacing import make_required
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
    ("findings", "instead_of"),
    [
        ([GAIN, DISC], [GAIN, NAMELESS]),
        ([DISC], [GAIN, NAMELESS]),
        ([GAIN, NAMELESS, DISC], [GAIN, NAMELESS]),
        ([GAIN, candidate("unknown", 3), NAMELESS], [GAIN, NAMELESS]),
    ],
)
def test_what_says_more_needs_to_be_likelier_and_not_contradicted(
    findings: list[Candidate], instead_of: list[Candidate]
) -> None:
    required = make_required(findings, instead_of)
    assert required.held_out(CLEARLY + 0.1) == -CONTRADICTED
    assert required.held_out(CLEARLY - 0.1) is None


@pytest.mark.parametrize("findings", [[DISC, NAMELESS], [SLIP], [GAIN, candidate("unknown", 3)]])
def test_other_names_must_predict_beyond_doubt(findings: list[Candidate]) -> None:
    instead_of = [GAIN, NAMELESS] if len(findings) > 1 else [GAIN]
    required = make_required(findings, instead_of)
    assert required.held_out(100.0) == REPLACING_SIGMAS
    assert required.held_out(0.0) is None


def test_causes_that_say_why_take_the_place_of_a_value_for_each_session() -> None:
    """Evidence within ten nats decides nothing there: readings held out do."""
    required = make_required([SLIP, candidate("thermal", 2)], [BY_SESSION])
    assert required.held_out(CLEARLY + 0.1) == -CONTRADICTED
    assert required.held_out(-9.0) == BEYOND_CHANCE > 0.0
    assert required.held_out(-11.0) is None
    assert make_required([BY_SESSION], [SLIP]).held_out(-9.0) is None
