"""What a fit may not do: go far from the model under test, shrink the arm, lose a length, or be of
a size that no such cause has."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.diagnose.fitting.neighbourhood import (
    compute_arm_size,
    compute_scale_factor,
    find_refusal,
    is_near,
    is_possible,
)
from armd.compensation.diagnose.problem.linear import ModelState
from armd.compensation.diagnose.problem.linearise import linearise
from armd.compensation.diagnose.problem.rests import collect_rests
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, tie
from armd.compensation.model.calibration import ArtefactCorrection
from support import synthetic

ARM = synthetic.arm()
NAMES = ARM.layout.names
LENGTHS = ARM.layout.are_lengths & (ARM.nominal() != 0.0)
UNCERTAINTY_MM = 0.001  # of the synthetic certified length


def candidate(cause: str, *typical: float, reach: float = np.inf) -> Candidate:
    columns = tuple(Column(f"c{i}", "1", size, reach=reach) for i, size in enumerate(typical))
    return Candidate(cause, location.joint(2), columns, ())


def test_a_named_cause_has_a_largest_size_and_a_blow_has_none() -> None:
    disc = candidate("encoder_eccentricity", 1.0, 2.0)
    assert is_possible(disc, np.array([150.0, -300.0]))
    assert not is_possible(disc, np.array([151.0, 0.0]))
    assert not is_possible(disc, np.array([0.0, -301.0]))
    bounded = candidate("sensor_offset", 0.5, reach=5.0)
    assert is_possible(bounded, np.array([7.4])) and not is_possible(bounded, np.array([7.6]))
    for cause in ("encoder_slip", "unknown"):
        assert is_possible(candidate(cause, 1.0), np.array([1e9]))


def test_what_acts_alike_is_bounded_alike() -> None:
    """A graduation of 340″ was refused where a wheel with as many teeth was not."""
    arc_second = math.pi / 180 / 3600
    waves = [
        ("encoder_eccentricity", 6.0),
        ("encoder_ellipticity", 3.0),
        ("encoder_periodic", 2.0),
        ("gear_mesh", 3.0),
    ]
    for cause, typical in waves:
        columns = (Column("sin", "rad", typical * arc_second),)
        wave = Candidate(cause, location.joint(2), columns, ())
        for far, is_one in ((340.0, True), (899.0, True), (-901.0, False)):
            assert is_possible(wave, np.array([far * arc_second])) == is_one, (cause, far)


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


@pytest.mark.parametrize(
    ("name", "near", "far", "told"),
    [("d_3", 9.9, 10.2, "d_3 by 10 mm"), ("alpha_4", 0.019, -0.021, "alpha_4 by 1.2°")],
)
def test_no_constant_leaves_what_an_arm_of_its_drawing_can_be(
    name: str, near: float, far: float, told: str
) -> None:
    assert is_near(fitted({name: near}), ARM)
    gone = fitted({name: far})
    assert not is_near(gone, ARM)
    assert find_refusal(gone, gone, ARM) == f"it would move {told}"
    assert is_near(fitted({"base_x": 1e4, "base_rz": 2.0}), ARM), "it was carried there"


def test_the_last_joint_and_the_tips_offset_place_one_point() -> None:
    """A twist of 3° is the same arm if the tip's offset turns back by as much: a calibration does
    not tell the two apart, and neither do readings. What moves the point itself is bounded."""
    angle = math.radians(3.0)
    _, y, z = ARM.nominal()[ARM.layout.tip]
    back = {
        "tip_y": y * (math.cos(angle) - 1.0) + z * math.sin(angle),
        "tip_z": z * (math.cos(angle) - 1.0) - y * math.sin(angle),
    }
    assert np.hypot(*back.values()) > 1.0, "the tip is off the axis of the twist"
    last = f"alpha_{ARM.n_joints}"
    assert is_near(fitted({last: angle, **back}), ARM)
    far = fitted({"tip_x": 10.2})
    assert find_refusal(far, far, ARM) == "it would move the tip's x by 10 mm"
    turned = fitted({last: 11.0 / math.hypot(y, z)})
    assert "the tip's" in find_refusal(turned, turned, ARM)


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


def test_what_no_cause_can_be_is_refused_by_its_size() -> None:
    one = fitted({})
    one.findings = (candidate("encoder_eccentricity", 1e-6, 1e-6),)
    one.amplitudes = (np.array([1e-3, 0.0]),)
    assert find_refusal(one, one, ARM) == "no such cause is that large"


@pytest.mark.parametrize(
    ("cause", "parameter", "size", "near"),
    [
        ("encoder_slip", "theta_2", 0.03, True),  # 1.7°
        ("unknown", "theta_2", 0.03, False),
        ("encoder_slip", "a_2", 12.0, False),
    ],
)
def test_what_a_named_cause_turns_makes_no_arm_smaller(
    cause: str, parameter: str, size: float, near: bool
) -> None:
    found = fitted({})
    column = Column("c", "1", 1.0, tie([(parameter, 1.0)]))
    found.findings = (Candidate(cause, location.joint(2), (column,), ()),)
    found.amplitudes = (np.array([size]),)
    assert is_near(found, ARM) == near
