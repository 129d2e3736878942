"""A name that accounts for too little: its share, the lower probability, the sentences."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.diagnose.constants import ENOUGH
from armd.compensation.diagnose.diagnosis import Explained, Finding
from armd.compensation.diagnose.report import verdict
from armd.compensation.diagnose.scoring.shape import locate_shape
from armd.compensation.diagnose.search import explained_share, findings
from armd.compensation.diagnose.search.explained_share import compute_explained_shares
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, Winding
from support.small_fit import candidate, small_fit

NAMED = candidate("encoder_scale", 3)  # depends on q3
BESIDE = Candidate(
    "unknown", location.parameter(2, "d_2(q3)"), (Column("d", "mm", 1.0),), ("q3", "q2")
)
ELSEWHERE = Candidate(
    "unknown", location.parameter(5, "a_5(q5)"), (Column("a", "mm", 1.0),), ("q5",)
)
MESH = candidate("gear_mesh", 3)
OVERWHELMING = -1e3


def scores_of(*left_out: tuple[Candidate, float]) -> Any:
    """Candidates that are in no finding, and what each explains of the rest (χ²)."""
    return SimpleNamespace(
        signatures=SimpleNamespace(candidates=[c for c, _ in left_out]),
        statistic=np.array([square for _, square in left_out]),
        freedom=np.ones(len(left_out)),
        log_p=np.full(len(left_out), OVERWHELMING),
    )


@pytest.fixture
def unparted(monkeypatch: pytest.MonkeyPatch) -> None:
    """No look at parts of the readings: what stands beside a cause decides."""
    monkeypatch.setattr(explained_share, "_checks", lambda *_: ())


def fit_of(*found: Candidate) -> Any:
    return SimpleNamespace(findings=found)


def test_the_share_is_of_all_that_its_variables_show(unparted: None) -> None:
    """χ² less one for its column: 100 of its own, 300 of an unknown finding in its variables, 100
    of what was left out in them; what depends on other joints does not count."""
    statistics, scores = [101.0, 301.0, 5001.0], scores_of((BESIDE, 101.0), (ELSEWHERE, 9001.0))
    (own, *_) = compute_explained_shares(fit_of(NAMED, BESIDE, ELSEWHERE), statistics, scores, 100)
    assert own.share == pytest.approx(100.0 / 500.0)
    assert own.guess and own.variables == ("q3", "q2")
    (alone,) = compute_explained_shares(fit_of(NAMED), [101.0], scores_of((ELSEWHERE, 9001.0)), 100)
    assert alone.share == 1.0 and not alone.guess


def test_a_form_of_its_own_is_not_explained_by_the_name(unparted: None) -> None:
    """χ² of 900 is the name's, 300 the shape's that it has instead of the catalogue's."""
    shape = Candidate("unknown", locate_shape(NAMED), (Column("s", "1", 1.0),), ("q3",))
    another = Candidate("unknown", locate_shape(ELSEWHERE), (Column("s", "1", 1.0),), ("q3",))
    (own, *_) = compute_explained_shares(
        fit_of(NAMED, shape, another), [901.0, 301.0, 9001.0], scores_of(), 100
    )
    assert own.share == pytest.approx(0.75)


def test_one_name_several_times_is_one_effect_without_a_name(unparted: None) -> None:
    """Two gears of a joint, of the sum of two angles and of one; a curve's orders are one curve."""
    sum_of, alone = (replace(MESH, depends_on=on) for on in (("q4", "q3"), ("q4",)))
    told = compute_explained_shares(
        fit_of(sum_of, alone, NAMED), [301.0, 101.0, 5001.0], scores_of(), 100
    )
    assert [each.share for each in told] == pytest.approx([0.75, 0.25, 1.0])
    orders = [replace(MESH, setting=(("order", order, "1/turn"),)) for order in (3.0, 5.0)]
    told = compute_explained_shares(fit_of(*orders), [301.0, 101.0], scores_of(), 100)
    assert [each.share for each in told] == [1.0, 1.0]


def test_the_way_before_counts_against_names_of_its_own_joint(unparted: None) -> None:
    """That joint 2 is wound up shares the time and its angle with many causes, and no more."""
    wound = [
        Candidate(
            "unknown",
            location.parameter(joint, f"theta_{joint}(q{joint}, q3, time_s, way before)"),
            (Column("w", "rad", 1.0, use=Winding(joint, 0.1, ((f"theta_{joint}", 1.0),))),),
            (f"q{joint}", "q3", "time_s"),
        )
        for joint in (2, 3)
    ]
    for before, share in zip(wound, (1.0, 0.25), strict=True):
        (found, _) = compute_explained_shares(
            fit_of(NAMED, before), [101.0, 301.0], scores_of(), 100
        )
        (left_out,) = compute_explained_shares(
            fit_of(NAMED), [101.0], scores_of((before, 301.0)), 100
        )
        assert found.share == left_out.share == pytest.approx(share)


def test_an_amplitude_that_changes_half_way_accounts_for_less(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One half of the rests shows three times what the other does: (1 ± ½) of the mean, so that
    the mean accounts for four fifths of the sum of squares."""
    n = 60
    own = np.zeros((3 * n, 1))
    own[::3] = 1.0
    half = np.repeat([0, 1], 30)
    signal = 40.0 * own[:, 0] * np.repeat(np.where(half == 0, 1.5, 0.5), 3)
    fit = small_fit(signal, np.zeros((3 * n, 0)), {NAMED: own})
    parts = ("time_s", half, ["before", "after"])
    monkeypatch.setattr(explained_share, "_partitions", lambda *_: iter([parts]))
    statistic = float(fit.fitted @ fit.fitted)
    (told,) = compute_explained_shares(fit, [statistic], scores_of(), 100)
    (check,) = told.checks
    assert check.ratio == pytest.approx([1.5, 0.5], rel=1e-2)
    assert check.p_value < 1e-12
    assert told.share == pytest.approx(0.8, abs=0.01)


@pytest.mark.parametrize("share", [0.3, ENOUGH - 1e-6, ENOUGH, 1.0])
def test_a_guess_is_no_surer_than_its_share(share: float, monkeypatch: pytest.MonkeyPatch) -> None:
    found = [Finding(c, 1e-9, 90.0, 0.99, (), ()) for c in (NAMED, ELSEWHERE)]
    own = Explained(share, ("q3",), ())
    monkeypatch.setattr(
        findings, "compute_explained_shares", lambda *_: [own, replace(own, variables=("q5",))]
    )
    scored: Any = SimpleNamespace(fit=None, scores=None)
    named, nameless = findings.report_findings(scored, found, 100)
    assert named.probability == pytest.approx(0.99 * (share if share < ENOUGH else 1.0))
    assert nameless.probability == 0.99  # it claims no name
    assert named.explained == own


def told_of(monkeypatch: pytest.MonkeyPatch, **changes: Any) -> str:
    """The verdict on one finding, written, that explains all, of a known size."""
    for name, value in (("_refused", []), ("_moved", []), ("is_size_known", True)):
        monkeypatch.setattr(verdict, name, lambda *_, value=value: value)
    found = Finding(NAMED, 1e-9, 90.0, 0.99, (), (), Explained(1.0, ("q3",), ()))
    searched = SimpleNamespace(findings=(NAMED,))  # no growth joined what the search found
    usual = {
        "search": SimpleNamespace(searched=searched, last=searched, rival_causes=()),
        "gains": [SimpleNamespace(is_confirmed=True)],
        "findings": [found],
        "written": (0,),
        "contradicted_later": (),
        "written_rms_um": (12.0, 6.0),
        "written_clear_um": None,
        "written_by": "",
        "later_gain_um": None,
        "heldout_rms_um": 12.0,
        "significant_rest": False,
        "outliers": (),
        "remaining_rms_um": 6.0,
        "noise_floor_um": 6.0,
        "touched": (),
        "remarks": (),
    }
    diagnosis: Any = SimpleNamespace(**{**usual, **changes})
    return verdict.write_verdict(diagnosis)


def test_the_verdict_calls_a_guess_a_guess(monkeypatch: pytest.MonkeyPatch) -> None:
    sentence = "The name of 1 is a guess"
    assert sentence not in told_of(monkeypatch)
    found = Finding(NAMED, 1e-9, 90.0, 0.3, (), (), Explained(0.3, ("q3",), ()))
    assert sentence in told_of(monkeypatch, findings=[found])
    assert sentence not in told_of(monkeypatch, findings=[replace(found, candidate=BESIDE)])


def test_the_verdict_tells_a_drift_that_foretells_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    gains = [SimpleNamespace(is_confirmed=False)]
    text = told_of(monkeypatch, gains=gains, written=(), contradicted_later=(0,))
    assert "What goes with time, 1, is not in it: fitted to the earlier readings" in text
    assert "none of them written" in text and "leads" not in text
    assert "What goes with time" not in told_of(monkeypatch)


def test_the_verdict_tells_what_remains_beyond_the_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "remain under the extended calibration" not in told_of(monkeypatch)
    text = told_of(monkeypatch, remaining_rms_um=30.0)
    assert "Yet 30.0 µm remain under the extended calibration" in text
    assert "the noise alone would leave 6.00 µm" in text


def test_the_verdict_tells_what_another_session_may_gain(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "another session" not in told_of(monkeypatch)
    text = told_of(monkeypatch, later_gain_um=(-0.5, 12.0))
    assert "In another session like these it gains -0.500 to 12.0 µm (95 %)." in text
