"""What an effect has clear of others' free amplitudes, against one dense least-squares problem."""

from types import SimpleNamespace

import numpy as np
import pytest
from cases import at_rests, projected_snr
from told_apart import told_apart

from armd.compensation.diagnose.problem.signatures import make_finding_columns
from armd.simulator.plants.plant import Plant
from support.first_fit import clear_of_absorbing, first_fit

DISC, GAIN = ("encoder_eccentricity", "joint 3"), ("encoder_scale", "joint 3")
ELSEWHERE = ("joint_backlash", "joint 5")


@pytest.fixture(scope="module")
def planted():
    """What stands for a diagnosis of small sessions, and each place's exact error (readings, 3)."""
    plants = [Plant(*DISC, 2.0), Plant(*GAIN, 8.0), Plant(*ELSEWHERE, 4.0)]
    made, first, arm, candidates = first_fit(7, plants)
    search = SimpleNamespace(
        first=first, last=first, signatures=SimpleNamespace(candidates=candidates)
    )
    errors = zip((DISC, GAIN, ELSEWHERE), made.errors_mm(), strict=True)
    return SimpleNamespace(search=search, arm=arm), dict(errors)


def dense(diagnosis, error: np.ndarray, others: list[np.ndarray]) -> float:
    """The same by numpy's least squares, everything that absorbs with its prior as rows."""
    first = diagnosis.search.first
    signal = clear_of_absorbing(first, first.noise.whiten(at_rests(first, error)))
    free = first.noise.whiten(np.column_stack(others))
    free = clear_of_absorbing(first, free / np.linalg.norm(free, axis=0))
    return float(np.linalg.norm(signal - free @ np.linalg.lstsq(free, signal, rcond=1e-9)[0]))


def columns_of(diagnosis, place) -> np.ndarray:
    own = [c for c in diagnosis.search.signatures.candidates if c.place == place]
    (only,) = make_finding_columns(diagnosis.search.first.linear, own, diagnosis.arm)
    return only


@pytest.mark.slow
def test_an_effect_is_clear_of_what_the_other_cause_may_do_at_any_size_and_phase(planted) -> None:
    diagnosis, errors = planted
    two = [errors[DISC], errors[GAIN]]
    disc, gain = told_apart(diagnosis, two, [DISC, GAIN])
    at = [at_rests(diagnosis.search.first, error) for error in two]
    able = [
        np.column_stack([at[i], columns_of(diagnosis, place)])
        for i, place in ((0, DISC), (1, GAIN))
    ]
    assert disc == pytest.approx(dense(diagnosis, two[0], [able[1]]), rel=1e-3)
    assert gain == pytest.approx(dense(diagnosis, two[1], [able[0]]), rel=1e-3)
    # Beside the disc's exact error alone, which no fit knows, more of the gain would seem there.
    exact = projected_snr(diagnosis.search.first, two[1], diagnosis.search.last.noise, two[:1])
    assert gain < 0.8 * exact


def test_what_another_can_do_wholly_cannot_be_told_and_what_is_elsewhere_can(planted) -> None:
    diagnosis, errors = planted
    twice = told_apart(diagnosis, [errors[DISC], errors[DISC]], [DISC, DISC])
    assert max(twice) < 0.5
    plain = projected_snr(diagnosis.search.first, errors[ELSEWHERE], diagnosis.search.last.noise)
    _, apart = told_apart(diagnosis, [errors[DISC], errors[ELSEWHERE]], [DISC, ELSEWHERE])
    assert apart == pytest.approx(plain, rel=0.05)
    assert apart > 5.0
