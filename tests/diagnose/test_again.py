"""Two searches of the same readings beside each other, made up as small as they may be."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from armd.compensation.diagnose.diagnosis import Finding
from armd.compensation.diagnose.search.again import no_surer, quieter, tells_less
from armd.compensation.effects.effect import Candidate
from support.small_fit import candidate

DISC, SCALE = candidate("encoder_eccentricity", 3), candidate("encoder_scale", 3)


def finding(cause: Candidate, probability: float) -> Finding:
    return Finding(cause, 1e-9, 90.0, probability, (), ())


def result(noise_um: float, *found: Finding) -> Any:
    noise = SimpleNamespace(own_mm=1e-3 * noise_um)
    return SimpleNamespace(last=SimpleNamespace(noise=noise), found=found)


@pytest.mark.parametrize(
    ("one", "other", "clearly"), [(6.0, 9.7, True), (6.0, 7.0, False), (7.0, 6.0, False)]
)
def test_a_tenth_less_noise_is_not_clearly_less(one: float, other: float, clearly: bool) -> None:
    assert quieter(result(one).last, result(other).last) is clearly


def test_less_is_told_only_where_no_more_is_left() -> None:
    one, two = (finding(DISC, 0.9),), (finding(DISC, 0.9), finding(SCALE, 0.9))
    assert tells_less(result(6.4, *one), result(6.0, *two))
    assert not tells_less(result(9.0, *one), result(6.0, *two))  # what it lacks is in its noise
    assert not tells_less(result(6.0, *two), result(6.0, *two))
    assert not tells_less(result(6.0), result(6.0, *two))  # something is there


def test_what_both_found_is_no_surer_than_either() -> None:
    found = (finding(DISC, 0.99), finding(SCALE, 0.4))
    again = result(6.0, finding(SCALE, 0.7), finding(DISC, 0.6))
    assert [f.probability for f in no_surer(found, again)] == [0.6, 0.4]
    other = result(6.0, finding(DISC, 0.6))
    assert no_surer(found, other) == found  # they are not the same
