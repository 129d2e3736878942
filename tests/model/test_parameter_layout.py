"""Where parameters stand, and what an arm says of itself once for all who ask."""

import numpy as np
import pytest

from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import compute_joint_jacobian
from armd.compensation.model.parameters import ParameterLayout, find_unit
from armd.errors import ArmdError
from support.small_arm import small_arm


@pytest.mark.parametrize("n_joints", [3, 6, 9])
def test_every_parameter_has_one_place(n_joints: int) -> None:
    layout = ParameterLayout(n_joints)
    numbers = np.arange(layout.count)
    parts = [layout.joint(k) for k in range(1, n_joints + 1)]
    together = np.concatenate([numbers[at] for at in (*parts, layout.tip, layout.base)])
    np.testing.assert_array_equal(together, numbers)
    assert [layout.index(name) for name in layout.names] == numbers.tolist()
    assert layout.names[layout.angles] == tuple(f"theta_{k}" for k in range(1, n_joints + 1))
    assert layout.names[layout.slice_of_joints("alpha")][-1] == f"alpha_{n_joints}"
    assert layout.names[layout.joint(2)] == ("theta_2", "d_2", "a_2", "alpha_2", "beta_2")
    assert layout.names[layout.tip] == ("tip_x", "tip_y", "tip_z")
    assert layout.names[layout.base][0] == "base_x" and layout.names[-1] == "base_rz"
    lengths = [
        name for name, length in zip(layout.names, layout.are_lengths, strict=True) if length
    ]
    assert {find_unit(name) for name in lengths} == {"mm"} and len(lengths) == 2 * n_joints + 6
    assert ParameterLayout.from_count(layout.count) == layout
    assert "d_1" in layout and "d_0" not in layout


@pytest.mark.parametrize("count", [0, 9, 38, 40])
def test_no_arm_has_so_many_parameters(count: int) -> None:
    with pytest.raises(ArmdError, match=f"no arm has {count} parameters"):
        ParameterLayout.from_count(count)


def test_a_name_that_the_arm_has_not_is_said() -> None:
    with pytest.raises(ArmdError, match="no parameter 'd_7' on an arm of 6 joints"):
        ParameterLayout(6).indices(["d_6", "d_7"])


def _arm(*joints: dict[str, object]) -> Arm:
    return Arm.model_validate(
        {
            "schema": "armd.arm/1",
            "serial_number": "A-1",
            "temperature_sensor": [{"name": "t1"}, {"name": "t2"}, {"name": "t3"}],
            "joint": list(joints),
            "tip": {"offset_mm": [3.0, 0.0, 4.0]},
        }
    )


def test_what_an_arm_says_of_itself() -> None:
    arm = _arm(
        {"a_mm": 300.0, "d_mm": 400.0, "temperature": "t3", "min_deg": -90.0},
        {"a_mm": 200.0, "alpha_deg": 30.0, "temperature": {"t1": 1.0, "t2": 0.0}},
        {"d_mm": -100.0, "max_deg": 45.0},
    )
    assert arm.used_sensors == ["t1", "t3"]  # t2 weighs nothing
    low, high = arm.limits_rad
    np.testing.assert_allclose(low, [-np.pi / 2, -np.inf, -np.inf])
    np.testing.assert_allclose(high, [np.inf, np.inf, np.pi / 4])
    assert arm.reach_mm == pytest.approx(500.0 + 200.0 + 100.0 + 5.0)
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (500, 3))
    levers = np.linalg.norm(compute_joint_jacobian(q, arm.nominal()), axis=1)
    assert levers.max() <= arm.reach_mm
    assert arm.nominal()[arm.layout.joint(2)].tolist() == [0.0, 0.0, 200.0, np.pi / 6, 0.0]


def test_a_joint_without_limits_turns_half_a_turn_either_way() -> None:
    arm = small_arm()
    free = arm.model_copy(
        update={"joint": [arm.joint[0], arm.joint[1].model_copy(update={"min_deg": None})]}
    )
    low, high = free.range_rad
    assert low == pytest.approx(np.radians([-170.0, -180.0]))
    assert high == pytest.approx(np.radians([170.0, 170.0]))
    assert np.isneginf(free.limits_rad[0][1])
