"""How alike two causes look: angles and what is left, on columns whose angle is known."""

import numpy as np
import pytest
from scipy.stats import chi2

from armd.compensation.diagnose.scoring import confusion
from support.small_fit import candidate, small_fit

N = 20
OWN, RIVAL = candidate("encoder_scale", 1), candidate("encoder_slip", 2)


def likeness(angle_deg: float, monkeypatch: pytest.MonkeyPatch, shared: float = 0.0):
    """A finding and a rival so far apart, both with *shared* times what the placement explains."""
    basis = np.linalg.qr(np.random.default_rng(1).normal(size=(3 * N, 4)))[0]
    placement, first, second, noise = basis.T
    turn = np.radians(angle_deg)
    own = 3.0 * first + shared * placement
    rival = 0.01 * (np.cos(turn) * first + np.sin(turn) * second) - shared * placement
    columns = {OWN: own[:, None], RIVAL: rival[:, None]}
    monkeypatch.setattr(
        confusion, "make_finding_columns", lambda _, of, __: [columns[c] for c in of]
    )
    residual = 10.0 * first + noise + 7.0 * placement
    fit = small_fit(residual, placement[:, None], {OWN: columns[OWN]})
    arm = None
    (found,) = confusion.compute_likeness(OWN, [RIVAL], fit, arm)  # type: ignore[arg-type]
    return found


@pytest.mark.parametrize("angle_deg", [5.0, 40.0, 90.0])
@pytest.mark.parametrize("shared", [0.0, 2.0])
def test_the_angle_is_that_beside_what_absorbs(angle_deg, shared, monkeypatch) -> None:
    found = likeness(angle_deg, monkeypatch, shared)
    assert found.angle_deg == pytest.approx(angle_deg, abs=0.02 if shared else 1e-6)
    # What the finding adds beside the rival: 10 units along it, less what the rival takes.
    expected = chi2.sf((10.0 * np.sin(np.radians(angle_deg))) ** 2, 1)
    assert found.remaining_p == pytest.approx(expected, rel=0.05)


def test_what_the_placement_takes_but_for_a_millionth_looks_like_nothing(monkeypatch) -> None:
    assert likeness(5.0, monkeypatch, shared=50.0).angle_deg == 90.0


def test_a_rival_of_the_same_signature_leaves_nothing(monkeypatch) -> None:
    found = likeness(0.0, monkeypatch)
    assert found.angle_deg == pytest.approx(0.0, abs=1e-4)
    assert found.remaining_p == 1.0
