"""Places as values: what they are called, and what the diagnosis asks of them."""

import pytest

from armd.compensation.effects import location
from armd.compensation.effects.location import ARTEFACT, BASE, TIP, Location


@pytest.mark.parametrize(
    ("place", "words"),
    [
        (location.joint(3), "joint 3"),
        (location.link(2), "link 2"),
        (TIP, "tip"),
        (BASE, "base"),
        (ARTEFACT, "artefact"),
        (location.target("S1"), "target S1"),
        (location.sensors("t1"), "sensor t1"),
        (location.sensors("t1", "t2"), "sensors t1, t2"),
        (location.parameter(4, "d_4(q1, t2)"), "d_4(q1, t2)"),
        (
            location.make_shape_location("joint_backlash", location.joint(5)),
            "shape of joint_backlash joint 5",
        ),
    ],
)
def test_a_place_is_called_as_results_call_it(place: Location, words: str) -> None:
    assert str(place) == f"{place}" == words


def test_places_are_told_apart_by_what_they_are() -> None:
    assert location.joint(3) == location.joint(3) != location.link(3)
    shape = location.make_shape_location("encoder_scale", location.joint(3))
    assert shape.kind == "shape" and shape.origin == ("encoder_scale", location.joint(3))
    assert shape.joint is None  # no cause has a place there
    assert location.parameter(4, "d_4(q1)").joint == 4
    assert TIP.joint is None
