"""How a beam hangs, against the tables of strength of materials."""

import numpy as np
import pytest

from armd.simulator.measured.artefact import Artefact, Sag


@pytest.mark.parametrize(
    ("supports", "place", "share"),
    [
        (1.0, 0.0, 1.0),  # 5 w L⁴/384 in the middle between supports at the ends,
        (1.0, 0.5, 57 / 80),  # 57 w L⁴/6144 a quarter of the way,
        (0.0, 1.0, 1.0),  # a cantilever from the middle: w l⁴/8 at its end,
        (0.0, 0.5, 17 / 48),  # 17 w l⁴/384 half-way
    ],
)
def test_a_uniform_beam_hangs_as_in_the_tables(supports: float, place: float, share: float) -> None:
    beam = Sag(0.03, 0, supports)
    found = beam.deflection_at(np.array([place, -place])) - beam.deflection_at(
        np.array([supports, supports])
    )
    assert found == pytest.approx([0.03 * share] * 2)


def test_on_airys_points_the_ends_stay_parallel() -> None:
    """Airy 1922: supports at 1/√3 of the half length leave the ends' slope zero; others do not."""
    ends = np.array([0.9999, 1.0])
    airy, wider = (np.diff(Sag(1.0, 0, s).deflection_at(ends))[0] for s in (3**-0.5, 0.62))
    assert abs(airy) < 1e-3 * abs(wider)


def test_only_weight_across_the_beam_bends_it() -> None:
    at = {"A": (0.0, 0.0, 0.0), "B": (100.0, 0.0, 0.0), "C": (200.0, 0.0, 0.0)}
    rng = np.random.default_rng(1)
    straight = Artefact.certified("beam", at, rng, manufacturing_mm=0.0)
    hanging = Artefact(**{**vars(straight), "sag": Sag(0.02, 0, 1.0)})
    target, warm = np.arange(3), np.full(3, 20.0)

    def moved(down: tuple[float, float, float]) -> np.ndarray:
        where = (target, warm, np.tile(down, (3, 1)))
        return hanging.positions(*where) - straight.positions(*where)

    assert moved((0.0, 0.0, -1.0)) == pytest.approx(np.array([[0, 0, 0], [0, 0, -0.02], [0, 0, 0]]))
    assert moved((-1.0, 0.0, 0.0)) == pytest.approx(np.zeros((3, 3)))
