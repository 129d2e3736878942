"""The certificate: granted where a calibration helps and describes the arm, refused in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session
from armd.compensation.identify.calibrate import Options, calibrate
from armd.compensation.identify.certificate import Misses, judge
from armd.compensation.identify.heldout import Errors
from support import synthetic

ARM = synthetic.arm()
OPTIONS = Options(thermal_order=0)
ARCSEC = np.pi / 180 / 3600


@pytest.mark.parametrize(
    ("size", "encoder_arcsec", "placements", "words", "step"),
    [
        (1.0, 5.0, 3, "", ""),
        (
            1.0, 5.0, 1, "1 placement, expected at least 3: another place may miss by any amount",
            "measure the artefact in 2 more places: `armd measure artefact ",
        ),
        (0.0, 5.0, 3, "", ""),
        (
            3.0, 900.0, 3, "more than 1 mm: no set of constants describes this arm",
            "`armd diagnose ",
        ),
    ],
)  # fmt: skip
def test_certificate(
    size: float, encoder_arcsec: float, placements: int, words: str, step: str
) -> None:
    rng = np.random.default_rng(3)
    truth = synthetic.disturbed(ARM, rng, size)
    session = synthetic.session(
        ARM, truth, rng, placements=placements, encoder_rad=encoder_arcsec * ARCSEC
    )
    result = calibrate([session], ARM, OPTIONS)
    certificate = result.certificate
    assert certificate.granted == (words == ""), certificate.reason
    assert words in certificate.reason
    left_out = "each placement" if placements > 1 else "every 8th reading"
    assert certificate.reason.startswith(f"{left_out} left out misses by ")
    assert result.held_out_in_words == left_out
    assert result.calibration.provenance["certificate"] == {
        "granted": certificate.granted,
        "reason": certificate.reason,
        "kind": "identification record, not an ISO 17025 certificate",
        "scale_known": True,
        "next_step": certificate.next_step,
    }
    assert (certificate.next_step == "") == certificate.granted
    assert step in certificate.next_step


def seats(rng: np.random.Generator, **changes: object) -> Session:
    truth = synthetic.disturbed(ARM, rng)
    settings: dict[str, object] = {"encoder_rad": 5 * ARCSEC, **changes}
    return synthetic.session(ARM, truth, rng, **settings)  # type: ignore[arg-type]


def test_a_joint_that_slips_between_placements_gets_none() -> None:
    """The drawing is right, and no constants describe what is wrong."""
    rng = np.random.default_rng(3)
    session = synthetic.session(ARM, ARM.nominal(), rng, encoder_rad=5 * ARCSEC)
    session.states.q[:, 2] += np.array([-1e-3, 0.0, 1e-3])[session.placement]
    certificate = calibrate([session], ARM, OPTIONS).certificate
    assert not certificate.granted
    assert "more than the 50% that shows a calibration to help" in certificate.reason
    assert "`armd diagnose " in certificate.next_step


@pytest.mark.parametrize("distances", [[], [(0, 1)]])
def test_without_a_length_it_is_not_for_lengths(distances: list[tuple[int, int]]) -> None:
    """Seats that nobody measured: the same readings fit an arm of any size."""
    session = seats(np.random.default_rng(8), targets=2, placements=4, known=False,
                    distances=distances, readings=180)  # fmt: skip
    certificate = calibrate([session], ARM, OPTIONS).certificate
    assert certificate.granted, certificate.reason
    assert certificate.scale_known == bool(distances)
    assert ("all of them may be wrong by the same share" in certificate.reason) != bool(distances)
    assert certificate.word == ("granted" if distances else "granted, but not for lengths")


def test_hardly_more_readings_than_unknowns_get_none() -> None:
    session = seats(np.random.default_rng(5), readings=36)
    certificate = calibrate([session], ARM, OPTIONS).certificate
    assert not certificate.granted
    assert "36 readings, expected at least 42" in certificate.reason
    # Another place takes 6 unknowns more: 48 postures.
    assert certificate.next_step.startswith("take at least 12 more readings ")


def test_a_fit_that_did_not_settle_gets_none() -> None:
    result = calibrate([seats(np.random.default_rng(6))], ARM, OPTIONS)
    assert result.certificate.granted
    misses = Misses(1e4, 1.0, result.heldout, result.heldout_by)
    again = judge(result.fit, False, misses, result.lengths)
    assert "the fit did not settle" in again.reason
    assert "`armd diagnose " in again.next_step
    assert not again.granted


def test_temperatures_that_cannot_be_together_get_none() -> None:
    """One session of two in degrees Fahrenheit: no value is impossible, both together are."""
    rng = np.random.default_rng(7)
    truth = synthetic.disturbed(ARM, rng)
    celsius, fahrenheit = (
        synthetic.session(
            ARM, truth, rng, readings=90, temperature_c=20.0, encoder_rad=5 * ARCSEC, name=name
        )
        for name in ("C", "F")
    )
    fahrenheit.states.temperature_c[:] = fahrenheit.states.temperature_c * 1.8 + 32.0
    certificate = calibrate([celsius, fahrenheit], ARM, OPTIONS).certificate
    assert not certificate.granted
    assert "t1 reads 19." in certificate.reason
    assert "(session F), expected at most 30 K apart" in certificate.reason
    assert certificate.next_step.startswith("write the temperatures of session F in °C")


def test_a_certified_length_that_contradicts_the_arm_gets_none() -> None:
    rng = np.random.default_rng(8)
    session = seats(rng, known=False, distances=[(0, 1), (1, 2), (2, 3)])
    good = calibrate([session], ARM, OPTIONS)
    assert good.certificate.granted, good.certificate.reason
    assert max(abs(length.off) for length in good.lengths) < 3
    wrong = [
        distance.model_copy(update={"length_mm": distance.length_mm + 0.5 * (i == 0)})
        for i, distance in enumerate(session.artefact.distances)
    ]
    artefact = session.artefact.model_copy(update={"distances": wrong})
    result = calibrate([replace(session, artefact=artefact)], ARM, OPTIONS)
    assert not result.certificate.granted
    assert "a certified length contradicts the arm: " in result.certificate.reason
    ends = wrong[0].between
    assert f"the length of {' to '.join(ends)} right" in result.certificate.next_step
    assert f"--targets {','.join(ends)}" in result.certificate.next_step
    written = result.as_json()["lengths"]
    assert max(abs(length["off"]) for length in written) > 3
    assert written[0]["certified_mm"] == pytest.approx(wrong[0].length_mm)


@pytest.mark.parametrize("placements", [3, 5, 8])
def test_another_placement_stays_below_what_is_promised(placements: int) -> None:
    """In 95 of 100 draws, however few placements there are and however much they differ."""
    rng = np.random.default_rng(placements)
    below = []
    for _ in range(4000):
        *seen, another = np.exp(rng.normal(5.0, 0.4, placements + 1))
        root = float(np.sqrt(np.mean(np.square(seen))))
        below.append(another <= Errors(root, root, 0, tuple(seen)).of_another_um)
    assert 0.94 < np.mean(below) < 0.97
    assert np.isnan(Errors(1.0, 1.0, 0, (1.0, 2.0)).of_another_um)


@pytest.mark.parametrize(("placements", "few"), [(4, True), (12, False)])
def test_the_promise_is_of_another_placement_where_few_were_measured(
    placements: int, few: bool
) -> None:
    session = seats(np.random.default_rng(8), placements=placements, readings=180)
    result = calibrate([session], ARM, OPTIONS)
    assert ("another placement may miss by up to" in result.certificate.reason) == few
    promised = result.as_json()["another_placement_um"]
    assert (promised is not None) == few
    assert not few or promised >= max(result.heldout.rms_um, np.mean(result.heldout.of_sets_um))
