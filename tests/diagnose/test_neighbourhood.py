"""What a fit may not do: lose a certified length. Scatter is stated as of an arm of one size."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.diagnose.fitting.neighbourhood import (
    compute_arm_size,
    compute_scale_factor,
    find_refusal,
)
from armd.compensation.diagnose.problem.linear import ModelState
from armd.compensation.diagnose.problem.linearise import linearise
from armd.compensation.diagnose.problem.rests import collect_rests
from armd.compensation.model.calibration import ArtefactCorrection
from support import synthetic

ARM = synthetic.arm()
NAMES = ARM.layout.names
LENGTHS = ARM.layout.are_lengths & (ARM.nominal() != 0.0)
UNCERTAINTY_MM = 0.001  # of the synthetic certified length


def fitted(changes: dict[str, float], known: bool = False, encoder_rad: float = 0.0) -> Any:
    """A fit that moves identified constants: all that the fit's own methods are not asked for."""
    session = synthetic.session(
        ARM,
        ARM.nominal(),
        np.random.default_rng(3),
        targets=4,
        spread_mm=80.0,
        known=known,
        distances=[(0, 1)],
        encoder_rad=encoder_rad,
    )
    model = ModelState(ARM.nominal(), (), 20.0, ArtefactCorrection())
    moved = [NAMES.index(name) for name in changes]
    return SimpleNamespace(
        findings=(),
        amplitudes=(),
        layout=SimpleNamespace(identified=slice(0, len(moved))),
        solution=-np.array(list(changes.values())),
        baseline=SimpleNamespace(model=model, is_given=False, parameters=tuple(moved), terms=()),
        model=model,
        linear=linearise(collect_rests([session], ARM), model, ARM),
    )


def all_lengths(share: float) -> dict[str, float]:
    nominal = ARM.nominal()
    return {NAMES[i]: share * float(nominal[i]) for i in np.flatnonzero(LENGTHS)}


def test_the_size_of_an_arm_is_that_of_its_lengths() -> None:
    smaller = fitted(all_lengths(-0.01))
    assert compute_arm_size(smaller, ARM) == pytest.approx(0.99)
    assert compute_arm_size(fitted({"theta_2": 0.01, "base_x": 500.0}), ARM) == pytest.approx(1.0)


def test_scatter_on_seats_is_stated_as_of_an_arm_that_kept_its_size() -> None:
    """Certified positions see a smaller arm err: there nothing is to be made up for."""
    assert compute_scale_factor(fitted(all_lengths(-0.01)), ARM) == pytest.approx(1 / 0.99)
    assert compute_scale_factor(fitted(all_lengths(-0.01), known=True), ARM) == 1.0


def test_a_certified_length_may_not_be_lost() -> None:
    """Of seats at which the true arm stood: a smaller arm has them closer to each other."""
    right = fitted({"d_1": 0.0})
    length = right.linear.rests.observations.distances.length_mm[0]
    share = 2.0 * UNCERTAINTY_MM / length
    assert find_refusal(fitted(all_lengths(-share)), right, ARM) == "", (
        "two uncertainties are allowed"
    )
    lost = fitted(all_lengths(-5 * share))
    assert "the certified length" in find_refusal(lost, right, ARM)
    assert "off by 10 of its uncertainties" in find_refusal(lost, right, ARM)
    worse = fitted(all_lengths(-6 * share))
    assert find_refusal(lost, worse, ARM) == "", "it was lost before, and by more"
    hardly = fitted(all_lengths(-4.8 * share))
    assert find_refusal(lost, hardly, ARM) == "", "and by less than one uncertainty less"
    assert find_refusal(lost, fitted(all_lengths(-4.4 * share)), ARM)


def test_seats_are_known_no_better_than_their_readings_scatter() -> None:
    """Forty readings a seat that scatter by some 50 µm leave a distance in doubt by some 0.01 mm,
    however well it is certified: an arm ten of its uncertainties too small loses nothing."""
    right = fitted({"d_1": 0.0}, encoder_rad=1e-4)
    share = 10.0 * UNCERTAINTY_MM / right.linear.rests.observations.distances.length_mm[0]
    assert find_refusal(fitted(all_lengths(-share), encoder_rad=1e-4), right, ARM) == ""
    lost = fitted(all_lengths(-20 * share), encoder_rad=1e-4)
    assert "the certified length" in find_refusal(lost, right, ARM)
