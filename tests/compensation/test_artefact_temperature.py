"""An artefact whose temperature somebody read now and then, or not at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armd.compensation.data.sessions.session import Session
from armd.compensation.data.soundness.soundness import fit_to_identify, make_sound
from armd.compensation.identify.evaluation.evaluate import evaluate
from support import synthetic

ARM = synthetic.arm()
STEEL_PER_K, WARM_C = 11.5e-6, 26.0
UNREAD = float("nan")


def of_steel(artefact_c: list[float], count: int = 30, name: str = "warm") -> Session:
    """Readings of an ideal arm on points that stand 6 K · 11.5 µm/(m K) farther apart than
    certified at 20 °C; *artefact_c* of the first rows, the others unread."""
    rng = np.random.default_rng(8)
    one = synthetic.session(
        ARM, ARM.nominal(), rng, readings=count, temperature_c=WARM_C, name=name
    )
    grown = 1.0 + STEEL_PER_K * (WARM_C - 20.0)
    targets = [
        target.model_copy(update={"position_mm": (np.array(target.position_mm) / grown).tolist()})
        for target in one.artefact.targets
    ]
    artefact = one.artefact.model_copy(
        update={"targets": targets, "expansion_per_k": STEEL_PER_K, "name": "steel plate"}
    )
    celsius = np.full(count, np.nan)
    celsius[: len(artefact_c)] = artefact_c
    return replace(one, artefact=artefact, artefact_c=celsius)


def test_a_row_without_has_the_last_temperature_and_the_first_rows_the_first() -> None:
    read = of_steel([UNREAD, 26.0, UNREAD, 22.0, UNREAD], count=5)
    np.testing.assert_array_equal(read.artefact_rise_k, [6, 6, 6, 2, 2])
    after = replace(read, artefact_before_c=24.0)  # a piece of a long session
    np.testing.assert_array_equal(after.artefact_rise_k, [4, 6, 6, 2, 2])
    unread = of_steel([], count=3)
    np.testing.assert_array_equal(unread.artefact_rise_k, [0, 0, 0])
    np.testing.assert_array_equal(replace(unread, artefact_before_c=24.0).artefact_rise_k, [4] * 3)


def test_a_temperature_read_once_counts_for_all_readings() -> None:
    """Half of the plate at 26 °C and half at 20 would leave µm of an arm without any error."""
    once = evaluate([of_steel([WARM_C])], ARM, None)
    assert once.distance_um.max() < 1e-3
    never = evaluate([of_steel([])], ARM, None)
    assert never.distance_um.max() > 3.0  # 69 µm/m: what there is to lose


def test_what_is_taken_instead_is_told() -> None:
    read, now_and_then = of_steel([WARM_C] * 30, name="all"), of_steel([WARM_C] * 2, name="some")
    unread, again = of_steel([], name="none"), of_steel([], name="nor here")
    given = [read, now_and_then, unread, again]
    for sound in (make_sound(given, ARM), fit_to_identify(given, ARM)):
        some, none = (line for line in sound.remarks if "artefact_c" in line)
        assert some == "some: artefact_c in 2 of 30 rows; a row without has the last one before it."
        assert none.startswith(
            "No artefact_c (none, nor here): steel plate is taken to be at 20 °C"
        )
        assert "it would err by 7" in none  # 11.5 µm/(m K) at 6 K and the scatter's highest


def test_an_artefact_that_does_not_expand_needs_no_temperature() -> None:
    unread = of_steel([])
    stable = replace(unread, artefact=unread.artefact.model_copy(update={"expansion_per_k": 0.0}))
    assert make_sound([stable], ARM).remarks == ()
