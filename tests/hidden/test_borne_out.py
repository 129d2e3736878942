"""What the extended calibration gets: findings that held-out readings bear out, and no others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.fitting.refit import Refits, solve_with_findings
from armd.compensation.diagnose.heldout.gain import compute_gain
from armd.compensation.diagnose.heldout.judge import HoldoutScheme
from armd.compensation.diagnose.heldout.validation import (
    choose_validated_findings,
    may_go_on_otherwise,
)
from armd.compensation.diagnose.report.result import as_json
from armd.compensation.diagnose.report.verdict import format_um, write_verdict
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, tie
from armd.compensation.model.pose_factors import Harmonic
from armd.compensation.model.slow_factors import After, Temperature, Time
from armd.simulator.campaigns.hidden import Design
from armd.simulator.plants.plant import Plant
from support.made_case import make_case
from support.planting import planted, rms_um, wave

GROUPS = np.repeat(np.arange(40), 5)


def search_of(*findings: Candidate) -> Any:
    return SimpleNamespace(last=SimpleNamespace(findings=findings), findings=findings)


def cause(k: int) -> Candidate:
    return Candidate("encoder_scale", location.joint(k), (), ())


def causes(n: int) -> Any:
    """A search that found a cause at each of the first joints."""
    return search_of(*map(cause, range(1, n + 1)))


def squares_of(worth: dict[tuple[int, ...], float], grown: float = 1.0) -> Any:
    """Squared residuals held out by findings in the model, readings with a common pattern."""
    pattern = 1.0 + 0.2 * np.random.default_rng(4).normal(size=len(GROUPS))

    def squares(some: Sequence[int], growth: bool) -> Any:
        return worth[tuple(some)] * (grown if growth else 1.0) * pattern

    return squares


def scheme(worth: dict[tuple[int, ...], float], grown: float = 1.0) -> HoldoutScheme:
    return HoldoutScheme(squares_of(worth, grown), GROUPS)


SHAPE = Candidate(
    "unknown", location.make_shape_location("encoder_scale", location.joint(1)), (), ("q1",)
)


@pytest.mark.parametrize(
    ("findings", "worth", "numbers", "doubted"),
    [
        pytest.param(
            causes(3),
            {(): 4.0, (0,): 3.0, (1,): 4.4, (2,): 3.5, (0, 1): 3.3, (0, 2): 2.0, (0, 1, 2): 2.2},
            (0, 2), {1},
            id="a harmful one is not, though the one after it helps",
        ),
        pytest.param(
            causes(2), {(): 4.0, (0,): 4.5, (1,): 3.0, (0, 1): 2.0}, (0, 1), set(),
            id="what helps beside a later one only gets its turn again",
        ),
        pytest.param(  # two that help only together, and a third beside which they still do
            causes(3),
            {(): 4.0, (0,): 4.0, (1,): 4.0, (2,): 4.2, (0, 1): 2.0, (0, 2): 4.2, (1, 2): 4.2,
             (0, 1, 2): 2.2},
            (0, 1), {2},
            id="a set that helps together carries nothing along that harms",
        ),
        pytest.param(
            search_of(cause(1), SHAPE), {(): 4.0, (0,): 4.5, (1,): 3.0, (0, 1): 4.4}, (), {0, 1},
            id="a shape is not without its cause",
        ),
    ],
)  # fmt: skip
def test_which_findings_are_written(
    findings: Any, worth: dict[tuple[int, ...], float], numbers: tuple[int, ...], doubted: set[int]
) -> None:
    chosen = choose_validated_findings(findings, [scheme(worth)], [True] * len(findings.findings))
    assert chosen.numbers == numbers
    assert set(chosen.doubts) == doubted


def test_a_drift_that_makes_later_readings_worse_is_told_and_not_written() -> None:
    """Placements left out between the others bear it out; only what comes after does not."""
    along = Time(since_unix_s=0.0, until_unix_s=9.0)
    terms = tie([("theta_1", 1.0)], along)
    drift = Candidate("geometry_shift", location.joint(1), (Column("a", "1", 1.0, terms),), ())
    schemes = [scheme({(): 4.0, (0,): 3.0, (1,): 3.8, (0, 1): 2.5})]
    for after, expected in ((4.1, ((1,), (0,))), (3.9, ((0, 1), ()))):
        later = squares_of({(): 4.0, (0,): after, (1,): 9.0, (0, 1): 9.1})
        chosen = choose_validated_findings(
            search_of(drift, cause(2)), schemes, [True, True], later=later
        )
        assert (chosen.numbers, chosen.contradicted_later) == expected


def test_a_temperature_that_stands_in_for_a_drift_is_asked_for_later_readings_too() -> None:
    """Placements between the others bear both out; only the eccentricity is the same at all times.
    Where nothing drifts, later readings are not asked."""
    along, warm = Time(since_unix_s=0.0, until_unix_s=9.0), Temperature(weights={"t1": 1.0})
    drift, expansion = (
        Candidate(
            "a cause", location.joint(k), (Column("a", "1", 1.0, tie([("d_1", 1.0)], f)),), ()
        )
        for k, f in ((1, along), (2, warm))
    )
    worth = {(): 4.0, (0,): 4.1, (1,): 3.0, (2,): 3.5, (0, 1): 3.1, (0, 2): 3.6, (1, 2): 2.5}
    schemes = [scheme(worth | {(0, 1, 2): 2.6})]
    later = squares_of({some: 4.0 + sum(some) for some in (*worth, (0, 1, 2))})
    chosen = choose_validated_findings(
        search_of(drift, expansion, cause(3)), schemes, [True] * 3, later=later
    )
    assert (chosen.numbers, chosen.contradicted_later) == ((2,), (1,))
    chosen = choose_validated_findings(search_of(drift, expansion, cause(3)), schemes, [True] * 3)
    assert chosen.numbers == (1, 2)


def test_later_readings_are_asked_beside_whatever_goes_on_nobody_knows_how() -> None:
    """A drift, what each session has a value of its own of, what has no name and goes with a
    temperature. A step stays what it is, an expansion goes by its sensor."""

    def of(cause: str, *columns: Sequence[Any]) -> Candidate:
        named = (Column(str(k), "1", 1.0, tie([("d_1", 1.0)], *f)) for k, f in enumerate(columns))
        return Candidate(cause, location.joint(1), tuple(named), ())

    early, late = After(instant_unix_s=1.0), After(instant_unix_s=2.0)
    warm, angle = Temperature(weights={"t1": 1.0}), Harmonic(kind="sin", joint=1)
    assert may_go_on_otherwise(of("a cause", [Time(since_unix_s=0.0, until_unix_s=9.0)]))
    assert may_go_on_otherwise(of("a cause", [early], [late]))
    assert may_go_on_otherwise(of("unknown", [warm, angle]))
    assert not any(map(may_go_on_otherwise, (of("a", [late]), of("a", [warm]))))
    assert not may_go_on_otherwise(of("unknown", [angle]))


def test_readings_held_out_make_doubtful_what_they_contradict() -> None:
    """By their likelihood ratio, and by no more than that the arm changed."""
    n = len(GROUPS)
    for share, expected in ((1.0, None), (1.0 + 2.0 / (1.5 * n), np.exp(-2.0)), (1.2, 0.05)):
        worth = {(): 4.0, (0,): 3.0, (1,): 4.0 * share, (0, 1): 3.0 * share}
        chosen = choose_validated_findings(causes(2), [scheme(worth)], [True] * 2)
        assert chosen.numbers == (0,)
        assert chosen.doubts == {1: pytest.approx(1.0 if expected is None else expected)}


def test_where_the_repeated_search_tells_nothing_the_placements_left_out_state_the_gain() -> None:
    """What is written must not stand beside figures of a search that found something else."""
    worth = {(): 4.0, (0,): 3.0, (1,): 3.5, (0, 1): 2.0}
    assert choose_validated_findings(causes(2), [scheme(worth)], [True] * 2).gains == {}
    chosen = choose_validated_findings(causes(2), [scheme(worth)], [True] * 2, repeated_tells=False)
    assert (chosen.numbers, chosen.by) == ((0, 1), "placements left out")
    rms_um = {some: 1e3 * np.sqrt(squares_of(worth)(some, False).mean()) for some in worth}
    for i, (before, after) in enumerate((((), (0,)), ((0,), (0, 1)))):
        assert chosen.gains[i].before_um == pytest.approx(rms_um[before])
        assert chosen.gains[i].after_um == pytest.approx(rms_um[after])


def test_nothing_is_written_that_could_not_be_found_again() -> None:
    assert (
        choose_validated_findings(causes(1), [scheme({(): 4.0, (0,): 3.0})], [False]).numbers == ()
    )


def test_what_one_placement_shows_its_targets_bear_out() -> None:
    """Without that placement nobody knows of it: no gain there is no word against it."""
    silent, shown, harm = (scheme({(): 4.0, (0,): after}) for after in (4.0, 2.0, 4.5))
    assert choose_validated_findings(causes(1), [silent, shown], [True]).numbers == (0,)
    assert choose_validated_findings(causes(1), [harm, shown], [True]).numbers == ()
    deaf = choose_validated_findings(causes(1), [harm, shown], [True], lambda _finding, _some: True)
    assert deaf.numbers == (0,)
    assert deaf.gains[0].is_confirmed


def test_placements_hear_a_finding_that_only_another_one_hides_from_them() -> None:
    """Beside the other, one placement alone shows it; by itself they all do, and contradict it."""
    schemes = [
        scheme({(): 4.0, (0,): 4.4, (1,): 4.6, (0, 1): 4.8}),
        scheme({(): 4.0, (0,): 3.0, (1,): 3.0, (0, 1): 2.0}),  # by target
    ]

    def beside_the_other(finding: int, some: tuple[int, ...]) -> bool:
        return finding == 0 and 1 in some

    assert choose_validated_findings(causes(2), schemes, [True] * 2, beside_the_other).numbers == ()
    assert choose_validated_findings(
        causes(2), schemes, [True] * 2, lambda finding, _: finding == 0
    ).numbers == (0,)


def test_gross_readings_have_no_voice_but_a_finding_that_makes_them_worse_is_not_written() -> None:
    """A decision clips them; the error over all readings is what the calibration will show."""
    gross = np.arange(len(GROUPS)) % 50 == 0

    def squares(worse: float) -> Any:
        usual = squares_of({(): 4.0, (0,): 2.0})
        return lambda some, growth: np.where(
            gross, 4000.0 * (worse if some else 1.0), usual(some, growth)
        )

    assert choose_validated_findings(
        causes(1), [HoldoutScheme(squares(1.0), GROUPS)], [True]
    ).numbers == (0,)
    assert (
        choose_validated_findings(causes(1), [HoldoutScheme(squares(1.2), GROUPS)], [True]).numbers
        == ()
    )


def test_the_first_links_growth_is_written_only_where_held_out_readings_bear_it_out() -> None:
    worth = {(): 4.0, (0,): 3.0}
    for grown, expected in ((0.7, True), (1.0, False), (1.3, False)):
        chosen = choose_validated_findings(causes(1), [scheme(worth, grown)], [True], growth=True)
        assert (chosen.numbers, chosen.growth) == ((0,), expected)
        assert chosen.after.sum() < chosen.before.sum()
    chosen = choose_validated_findings(
        causes(1), [scheme({(): 4.0, (0,): 4.0}, 0.5)], [True], growth=True
    )
    assert (chosen.numbers, chosen.growth) == ((), False)
    assert (chosen.after == chosen.before).all()


def test_a_scheme_that_is_deaf_to_the_first_links_growth_does_not_speak_of_it() -> None:
    """The one ramp that shows the growth was left out whole: the others cannot foretell it."""
    worth = {(): 4.0, (0,): 3.0}
    for by_target, expected in ((0.99, True), (1.01, False)):
        schemes = [scheme(worth, grown) for grown in (1.2, by_target)]
        chosen = choose_validated_findings(
            causes(1), schemes, [True], growth=True, cannot_see_growth=True
        )
        assert (chosen.numbers, chosen.growth) == ((0,), expected)
        assert chosen.after.sum() == pytest.approx(0.75 * chosen.before.sum())
        heard = choose_validated_findings(causes(1), schemes, [True], growth=True)
        assert not heard.growth


def test_rounding_is_no_gain() -> None:
    before = np.full(len(GROUPS), 1e-2)
    assert not compute_gain(before, before * (1.0 - 1e-13), GROUPS).is_confirmed


@pytest.fixture(scope="module")
def disturbed() -> Any:
    """Four sessions with bad readings and an eccentricity; two held out, with a bad one too."""
    design = Design(sessions=5, articulations=3, holdout=2)
    made = make_case(611, [Plant("outliers", "rows", 150.0)], design)
    sessions, holdout = (planted(some, wave(2, 8.0)) for some in (made.sessions, made.holdout))
    q = holdout[0].states.q.copy()
    q[7] += 3e-4  # 60 arc seconds in every joint
    holdout[0] = replace(holdout[0], states=replace(holdout[0].states, q=q))
    return made.arm, sessions, holdout


@pytest.mark.slow
def test_every_held_out_reading_counts(disturbed: Any) -> None:
    """A bad reading held out that nobody named was left out of the figure beside it."""
    arm, sessions, holdout = disturbed
    found = diagnose(sessions, arm, holdout=holdout)
    assert found.outliers
    assert found.outlier_gain is not None
    told = found.outlier_gain
    assert told.after_um == pytest.approx(rms_um(holdout, arm, found.extended))
    assert found.written_rms_um[1] == pytest.approx(rms_um(holdout, arm, found.extended))
    assert found.heldout_rms_um == pytest.approx(rms_um(holdout, arm, found.baseline.calibration))
    assert told.before_um == told.after_um
    assert f"{format_um(found.written_rms_um[1])} µm instead" in write_verdict(found)


@pytest.mark.slow
def test_with_nothing_borne_out_the_file_predicts_what_the_model_under_test_does(
    disturbed: Any,
) -> None:
    """The eccentricity is gone in the sessions held out: mending it only does harm there."""
    arm, sessions, holdout = disturbed
    healthy = planted(holdout, wave(2, -8.0))
    found = diagnose(sessions, arm, holdout=healthy)
    given, written = found.baseline.calibration, found.extended
    assert len(found.findings) == 1
    assert found.written == ()
    assert not found.gains[0].is_confirmed
    assert (written.constants, written.terms) == (given.constants, given.terms)
    assert written.provenance["diagnosis"]["not_borne_out"] == ["encoder_eccentricity joint 2"]
    result = as_json(found, "ext.json")
    assert not result["findings"][0]["in_extended_calibration"]
    assert "predicts what the model under test does" in result["verdict"]


@pytest.mark.slow
def test_some_of_the_findings_are_fitted_as_if_there_were_no_others(disturbed: Any) -> None:
    """Taken out of sums that were made once, and made anew."""
    arm, sessions, _ = disturbed
    last = diagnose(planted(sessions, wave(4, 8.0, 2)), arm).search.last
    assert len(last.findings) == 2
    for some in ((), (0,), (1,), (0, 1)):
        short = Refits(last).with_subset(some)
        anew = solve_with_findings(last, [last.findings[i] for i in some], arm)
        assert short.fitted == pytest.approx(anew.fitted, abs=1e-7)
        for one, other in zip(short.amplitudes, anew.amplitudes, strict=True):
            assert one == pytest.approx(other, rel=1e-4)
