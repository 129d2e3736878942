"""What is asked for, and what no reading can tell: by counting, by words, by plain derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from armd.compensation.estimate.gauge import (
    compute_gauge,
    describe_unidentifiable,
    find_parallel_joints,
    is_scale_free,
    list_free_constants,
)
from armd.compensation.estimate.unknowns import PLAUSIBLE_TERM, Unknowns, describe_term
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import compute_jacobian
from armd.compensation.model.pose_factors import GravityTorque
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term
from support import synthetic
from support.plain_kinematics import tip_pose

ARM = synthetic.arm()
NAMES = ARM.layout.names


def with_parallel_axes() -> Arm:
    """Joint 2's axis 40 mm beside joint 3's, and within half a degree of it."""
    joints = [joint.model_dump(mode="json") for joint in ARM.joint]
    joints[1]["alpha_deg"] = 179.5
    return Arm.model_validate(ARM.model_dump(mode="json", by_alias=True) | {"joint": joints})


def columns_of(arm: Arm, unknowns: Unknowns, n: int = 60) -> np.ndarray:
    q = np.random.default_rng(1).uniform(-2.5, 2.5, (n, arm.n_joints))
    moved = compute_jacobian(q, np.tile(arm.nominal(), (n, 1)))[1]
    return unknowns.columns(moved, np.zeros((n, 0)), [])


def scales(names: list[str]) -> np.ndarray:
    return Unknowns(names).get_plausible([], np.zeros((1, 0)))


def null_of(arm: Arm) -> tuple[np.ndarray, list[str]]:
    names = list_free_constants(arm)
    return compute_gauge(columns_of(arm, Unknowns(names)), scales(names)), names


def test_where_axes_are_parallel_a_tilt_is_asked_for_and_not_a_place() -> None:
    arm = with_parallel_axes()
    assert find_parallel_joints(ARM) == [] and find_parallel_joints(arm) == [2]
    assert "beta_2" in list_free_constants(arm) and "d_2" not in list_free_constants(arm)
    assert len(list_free_constants(arm)) == len(list_free_constants(ARM)) == 4 * 6 + 3


@pytest.mark.parametrize("arm", [ARM, with_parallel_axes()], ids=["crossed", "parallel"])
def test_no_more_is_free_than_a_count_of_frames_says(arm: Arm) -> None:
    """θ₁ and d₁ place the whole arm. Behind the last axis a point has three numbers, and θ, d, a, α
    and the tip's offset are seven: four of them are a choice."""
    null, names = null_of(arm)
    assert null.shape == (27, 6)
    flat = columns_of(arm, Unknowns(names)).reshape(-1, 27) * scales(names)
    assert np.abs(flat @ null).max() < 1e-7 * np.abs(flat).max()


def test_each_is_told_in_words() -> None:
    null, names = null_of(ARM)
    told = describe_unidentifiable(null, names, ARM)
    assert sum("whole arm about its first axis" in line for line in told) == 2
    assert sum("last joint's constants and the tip's offset" in line for line in told) == 4
    assert not is_scale_free(null, names, ARM)
    assert describe_unidentifiable(null[:, :0], names, ARM) == []


def test_all_lengths_in_proportion_are_the_size_of_the_arm() -> None:
    names = list_free_constants(ARM)
    drawn = dict(zip(NAMES, ARM.nominal(), strict=True))
    size = np.array([drawn[name] if name[0] in "dat" and "_" in name else 0.0 for name in names])
    size[[name.startswith(("theta", "alpha")) for name in names]] = 0.0
    size /= np.linalg.norm(size)
    assert is_scale_free(size[:, None], names, ARM)
    (line,) = describe_unidentifiable(size[:, None], names, ARM)
    assert line.endswith("no certified length determines the scale of the arm well enough")
    one = np.array([1.0 * (name == "a_2") for name in names])
    assert not is_scale_free(one[:, None], names, ARM)


WARM = Term(parameter="d_3", basis=[Temperature(weights={"t3": 1.0})], coefficient=0.25)
BENT = Term(parameter="theta_2", basis=[GravityTorque(joint=2)], coefficient=-3e-5)
ASKED = Unknowns(["a_2", "theta_1", "theta_4"], [1, 0])


def test_what_is_asked_for_is_taken_and_put_in_the_same_order() -> None:
    constants, terms = ARM.nominal(), [WARM, BENT]
    place = [NAMES.index(name) for name in ("a_2", "theta_1", "theta_4")]
    assert ASKED.names == ["a_2", "theta_1", "theta_4", "term 1", "term 0"]
    before = ASKED.values(constants, terms)
    assert before.tolist() == [*constants[place], -3e-5, 0.25]
    x = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    put, changed = ASKED.put(x, constants, terms)
    assert ASKED.values(put, changed).tolist() == x.tolist()
    assert (changed[0].coefficient, changed[1].coefficient) == (5.0, 4.0)
    others = np.delete(np.arange(len(constants)), place)
    assert (put[others] == constants[others]).all()
    assert ASKED.values(constants, terms).tolist() == before.tolist()  # nothing was written over


def test_columns_are_plain_derivatives_but_what_moves_the_whole_arm() -> None:
    rng = np.random.default_rng(2)
    q, p = rng.uniform(-2.0, 2.0, (4, 6)), np.tile(ARM.nominal(), (4, 1))
    basis = rng.normal(size=(4, 2))

    def moved(name: str, by: np.ndarray | float = 1.0) -> np.ndarray:
        h, off = 1e-6, np.zeros_like(p)
        off[:, NAMES.index(name)] = h * np.asarray(by)
        return (tip_pose(q, p + off) - tip_pose(q, p - off))[:, :3, 3] / (2.0 * h)

    found = ASKED.columns(compute_jacobian(q, p)[1], basis, [WARM, BENT])
    assert found[:, :, 0] == pytest.approx(moved("a_2"), abs=1e-6)
    assert (found[:, :, 1] == 0.0).all()  # θ₁
    assert found[:, :, 2] == pytest.approx(moved("theta_4"), rel=1e-6, abs=1e-5)
    assert found[:, :, 3] == pytest.approx(moved("theta_2", basis[:, 1]), rel=1e-6, abs=1e-5)
    assert found[:, :, 4] == pytest.approx(moved("d_3", basis[:, 0]), abs=1e-6)


def test_a_term_is_plausible_by_what_its_basis_makes_of_it() -> None:
    basis = np.array([[3.0, 0.5], [-4.0, 0.5]])  # rms 3.5355 and 0.5
    found = ASKED.get_plausible([WARM, BENT], basis)
    assert found[:3].tolist() == [10.0, 0.02, 0.02]
    assert found[3] == pytest.approx(PLAUSIBLE_TERM * 0.02 / 0.5)
    assert found[4] == pytest.approx(PLAUSIBLE_TERM * 10.0 / np.sqrt(12.5))


def test_a_term_in_words() -> None:
    squared = Temperature(weights={"t3": 0.5, "t4": 0.5}, order=2)
    assert (
        describe_term(Term(parameter="d_3", basis=[squared], coefficient=1.0)) == "d_3·ΔT²(t3+t4)"
    )
    assert ASKED.words([WARM, BENT])[3:] == ["theta_2·gravity_torque(2)", "d_3·ΔT(t3)"]
