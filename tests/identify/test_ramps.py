"""Sessions measured while the room warms: the first link's growth is told, and misleads nothing."""

import pytest

from armd.compensation.identify.calibrate import calibrate
from armd.compensation.identify.result import Result
from armd.compensation.model.terms import Term
from armd.simulator.campaigns.hidden import Design
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.true_values import list_true_expansion
from support.made_case import make_case
from support.planting import rms_um

SEED = 3
RAMPS = Design(ramp_k_per_h=8.0, ramps=3, articulations=4)
STEADY = Design(ramp_k_per_h=0.0, ramps=0, articulations=4)


def calibrated(before: Design) -> tuple[Result, float]:
    """Of four sessions so measured; and its RMS error in µm over six later ones at steady
    temperatures, which had no part."""
    design = Design(
        sessions=4, articulations=4, holdout=2, ramp_k_per_h=0.0, ramps=0, before=4, earlier=before
    )
    made = make_case(SEED, (), design)
    result = calibrate(made.before, made.arm)
    return result, rms_um([*made.sessions, *made.holdout], made.arm, result.calibration)


def growth(result: Result) -> list[Term]:
    return [term for term in result.calibration.terms if term.parameter == "d_1"]


@pytest.mark.slow
def test_ramps_show_how_the_first_link_grows_and_nothing_else() -> None:
    """In the simulator's own physics every link grows, the first as well. While it was not in the
    model, three sessions on ramps of 8 K/h made every length a cubic of its temperature."""
    ramped, ramped_um = calibrated(RAMPS)
    _, steady_um = calibrated(STEADY)
    assert ramped.thermal_order == 1
    (term,) = growth(ramped)
    true = sum(mm for name, _, mm in list_true_expansion(TrueArm.default(SEED)) if name == "d_1")
    assert term.standard_uncertainty is not None
    assert term.coefficient == pytest.approx(true, abs=3.0 * term.standard_uncertainty)
    assert term.standard_uncertainty < 0.1 * true
    assert ramped_um < 1.05 * steady_um


def test_steady_temperatures_say_nothing_of_the_first_link() -> None:
    result, _ = calibrated(STEADY)
    assert growth(result) == []
