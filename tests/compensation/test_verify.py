"""Every figure against one calculated by hand, the decision rule at its edges."""

from __future__ import annotations

import datetime
import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from armd.compensation.data.sessions.format import Artefact
from armd.compensation.data.sessions.session import Session
from armd.compensation.model.arm import Arm
from armd.compensation.report.verification.page import make_verification_report
from armd.compensation.verify.figures import evaluate_figures
from armd.compensation.verify.limits import PermissibleErrors, TestUncertainty, load_limits
from armd.compensation.verify.results import Figure, Verification
from armd.compensation.verify.spheres import find_smallest_sphere, fit_sphere
from armd.compensation.verify.verdict import Verdict, judge
from armd.errors import BadInput
from support.readings import session_of, states_of

TIP_RADIUS_MM, DIAMETER_MM = 3.0, 25.0
ARM = Arm.model_validate(
    {
        "schema": "armd.arm/1",
        "serial_number": "TEST",
        "joint": [{"d_mm": 200.0}, {"a_mm": 400.0}, {"a_mm": 400.0}],
        "tip": {"radius_mm": TIP_RADIUS_MM},
    }
)
EXACT = TestUncertainty(artefact_temperature_c=0.0)


class Measured:
    """Collects points by target and placement, and makes a session of them."""

    def __init__(self, expansion_per_k: float = 0.0, artefact_c: float = math.nan) -> None:
        self.rows: list[tuple[str, str, np.ndarray]] = []
        self.lengths: list[dict[str, object]] = []
        self.expansion_per_k, self.artefact_c = expansion_per_k, artefact_c

    def add(self, placement: str, target: str, *points: object) -> None:
        self.rows += [(placement, target, np.array(point, float)) for point in points]

    def certify(self, a: str, b: str, length_mm: float, uncertainty_mm: float = 0.0) -> None:
        self.lengths.append(
            {"between": [a, b], "length_mm": length_mm, "standard_uncertainty_mm": uncertainty_mm}
        )

    def figures(self, test: TestUncertainty = EXACT) -> Verification:
        points = np.array([point for _, _, point in self.rows])
        return evaluate_figures(self.session(), ARM, points, test)

    def session(self) -> Session:
        targets = dict.fromkeys([target for _, target, _ in self.rows])
        targets |= {name: None for length in self.lengths for name in length["between"]}
        placements = list(dict.fromkeys(placement for placement, _, _ in self.rows))
        artefact = Artefact.model_validate(
            {
                "name": "test",
                "expansion_per_k": self.expansion_per_k,
                "target": [{"name": name} for name in targets],
                "distance": self.lengths,
            }
        )
        n = len(self.rows)
        none = np.zeros((n, 3))
        names = list(targets)
        begun = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
        return session_of(
            "session",
            "TEST",
            artefact,
            states_of(none, temperature_c=np.zeros((n, 0)), time_s=np.zeros(n)),
            started_unix_s=begun.timestamp(),
            placement=np.array([placements.index(placement) for placement, _, _ in self.rows]),
            placement_names=placements,
            target=np.array([names.index(target) for _, target, _ in self.rows]),
            artefact_c=np.full(n, self.artefact_c),
        )


def limits_of(mpe: dict[str, float], **more: object) -> PermissibleErrors:
    return PermissibleErrors.model_validate({"schema": "armd.mpe/1", "mpe": mpe, **more})


def only(verification: Verification, *keys: str) -> list[Figure]:
    found = {figure.key: figure for figure in verification.figures}
    assert set(found) == set(keys), verification.left_out
    return [found[key] for key in keys]


def values(figure: Figure) -> list[float]:
    return [deviation.value_mm for deviation in figure.deviations]


CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3))) / math.sqrt(3)
AXES = np.vstack([np.eye(3), -np.eye(3)])
EDGES = np.array(
    [p for p in itertools.product((-1.0, 0.0, 1.0), repeat=3) if np.count_nonzero(p) == 2]
) / math.sqrt(2)


def a_ball(centre: tuple[float, float, float], radius: float, bump: float = 0.0) -> np.ndarray:
    """26 points of cubic symmetry, whose bumps neither move nor swell the best sphere."""
    points = [AXES * (radius + bump), CORNERS * (radius - 0.75 * bump), EDGES * radius]
    return np.array(centre) + np.vstack(points)


def test_probing() -> None:
    measured = Measured()
    measured.certify("SPHERE.a", "SPHERE.b", DIAMETER_MM, 0.0002)
    radius = DIAMETER_MM / 2 + TIP_RADIUS_MM
    for where, error, bump in (("SPHERE1", 0.010, 0.004), ("SPHERE2", -0.015, 0.008)):
        points = a_ball((300.0, 100.0, 50.0), radius + error, bump)
        for i, point in enumerate(points):
            measured.add(where, f"{where}.{i:02d}", point)
    size, form = only(measured.figures(), "p_size", "p_form")
    assert values(size) == pytest.approx([0.020, -0.030], abs=1e-7)
    assert size.worst.label == "SPHERE2"
    assert size.worst.standard_uncertainty_mm == 0.0002
    assert values(form) == pytest.approx([0.007, 0.014], abs=1e-6)


def test_location() -> None:
    measured = Measured()
    centres = [(0, 0, 0), (0.03, 0, 0), (0.015, 0.005, 0), (0.02, -0.005, 0.002), (0.01, 0, 0)]
    for k, centre in enumerate(centres, 1):
        points = np.array(centre) + 15.5 * np.vstack([AXES[:3], AXES[3:5]])
        for i, point in enumerate(points):
            measured.add("LDIA", f"LDIA.{k}.{i}", point)
    (location,) = only(measured.figures(), "l_dia")
    assert values(location) == pytest.approx([0.03], abs=1e-9)


def test_lengths_at_the_artefacts_temperature() -> None:
    """1 m of 10 µm/(m·K) is 100 µm longer at 30 °C; its uncertainty by 0.1 K is 1 µm."""
    measured = Measured(expansion_per_k=10e-6, artefact_c=30.0)
    for i in range(1, 6):
        measured.certify("L0", f"L{i}", 200.0 * i, 0.0005)
    for placement in range(7):
        direction = np.array([math.cos(placement), math.sin(placement), 0.0])
        for repeat in range(3):
            measured.add(f"P{placement}", "L0", [0, 0, 5.0])
            for i in range(1, 6):
                error = 0.020 if (placement, repeat, i) == (4, 2, 5) else -0.001 * i
                length = 200.0 * i * (1 + 10e-6 * 10) + error
                measured.add(f"P{placement}", f"L{i}", [0, 0, 5.0] + direction * length)
    verification = measured.figures(TestUncertainty())
    (lengths,) = only(verification, "e_uni")
    assert len(lengths.deviations) == 105
    assert lengths.worst.value_mm == pytest.approx(0.020, abs=1e-9)
    assert lengths.worst.label == "P4 L5 repeat 3"
    assert lengths.worst.length_mm == pytest.approx(1000.1)
    assert lengths.worst.standard_uncertainty_mm == pytest.approx(math.hypot(0.0005, 0.001))
    for range_mm, remarks in ((1500.0, 0), (1600.0, 1)):
        limits = limits_of({"e_uni_mm": 0.05}, measuring_range_mm=range_mm)
        told = [one for one in judge(verification, limits).remarks if "measuring range" in one]
        assert len(told) == remarks


def test_effective_diameter() -> None:
    measured = Measured()
    measured.certify("SPHERE.a", "SPHERE.b", DIAMETER_MM)
    points = np.vstack([AXES, EDGES[:3]])
    for repeat, error in ((1, 0.001), (2, -0.002), (3, 0.004)):
        for i, point in enumerate(points * (15.5 + error)):
            measured.add("EFFDIA", f"EFFDIA.{repeat}.{i}", point)
    (diameter,) = only(measured.figures(), "effective_diameter")
    assert values(diameter) == pytest.approx([0.002, -0.004, 0.008], abs=1e-8)


def test_articulation() -> None:
    """Ten readings ±10 µm along x: δ = 10 µm, s = √(10·100/9) µm."""
    measured = Measured()
    for seat, size in (("SPAT1", 0.01), ("SPAT2", 0.02), ("SPAT3", 0.03)):
        measured.add(seat, seat, *([(500 + size * (-1) ** i, 7, 9) for i in range(10)]))
    largest, spread = only(measured.figures(), "spat_max", "spat_2s")
    assert values(largest) == pytest.approx([0.01, 0.02, 0.03])
    assert values(spread)[0] == pytest.approx(2 * 0.01 * math.sqrt(10 / 9))


def test_volumetric() -> None:
    """Ten of +10 µm, ten of −20 µm: RMS = √((100 + 400)/2) µm."""
    measured = Measured()
    for bar, length, error in (("BARS", 700.0, 0.01), ("BARL", 1500.0, -0.02)):
        measured.certify(f"{bar}.a", f"{bar}.b", length)
        for i in range(10):
            measured.add(f"{bar}{i}", f"{bar}.a", (i, 0, 0))
            measured.add(f"{bar}{i}", f"{bar}.b", (i, length + error, 0))
    largest, rms, span = only(
        measured.figures(), "volumetric_max", "volumetric_2rms", "volumetric_range"
    )
    assert largest.worst.value_mm == pytest.approx(-0.02)
    assert values(rms) == pytest.approx([2 * 0.01 * math.sqrt(2.5)])
    assert values(span) == pytest.approx([0.03])


def test_what_is_incomplete_is_left_out_with_the_reason() -> None:
    measured = Measured()
    measured.certify("SPHERE.a", "SPHERE.b", DIAMETER_MM)
    for i, point in enumerate(a_ball((0, 0, 0), 15.5)[:24]):
        measured.add("SPHERE1", f"SPHERE1.{i:02d}", point)
    measured.add("SPAT1", "SPAT1", *[(i, 0, 0) for i in range(9)])
    verification = measured.figures()
    assert verification.figures == ()
    assert verification.left_out["p_size"] == "24 of 25 points on SPHERE1.*"
    assert verification.left_out["spat_2s"] == "9 of 10 articulations in SPAT1"
    verdict = judge(verification, limits_of({"p_size_mm": 0.01}))
    assert not verdict.passed
    assert set(verdict.not_tested) == {"p_size"}


def test_gauge_blocks_are_missed_only_where_they_have_a_limit() -> None:
    measured = Measured()
    measured.add("SPAT1", "SPAT1", *[(0.01 * (i % 2), 0, 0) for i in range(10)])
    verification = measured.figures()
    verdicts = {
        key: judge(verification, limits_of({key: 0.01})) for key in ("p_size_mm", "block_length_mm")
    }
    assert "block_length" not in judge(verification, None).as_json()["not_supported"]
    assert "block_length" not in verdicts["p_size_mm"].as_json()["not_supported"]
    missed = verdicts["block_length_mm"].as_json()
    assert missed["passed"] is False
    assert missed["not_tested"] == {
        "block_length": "no two planes with a certified length between them were touched"
    }
    assert "block_length" in missed["not_supported"]


@pytest.mark.parametrize(
    ("decision", "error_mm", "outcome"),
    [
        ("guarded", 0.0159, "conforms"),
        ("guarded", -0.0161, "not proven"),
        ("guarded", 0.0239, "not proven"),
        ("guarded", -0.0241, "does not conform"),
        ("simple", 0.0199, "conforms"),
        ("simple", 0.0201, "does not conform"),
    ],
)
def test_decision_rule(decision: str, error_mm: float, outcome: str) -> None:
    """Limit 20 µm, expanded uncertainty 4 µm."""
    measured = Measured()
    measured.certify("SPHERE.a", "SPHERE.b", DIAMETER_MM, 0.002)
    points = np.vstack([AXES, EDGES[:3]]) * (15.5 + error_mm / 2)
    for repeat in (1, 2, 3):
        for i, point in enumerate(points):
            measured.add("EFFDIA", f"EFFDIA.{repeat}.{i}", point)
    known = {"artefact_temperature_c": 0.0}
    limits = limits_of({"effective_diameter_mm": 0.02}, decision=decision, uncertainty=known)
    verdict = judge(measured.figures(limits.uncertainty), limits)
    (item,) = verdict.judged
    assert item.outcome == outcome
    assert verdict.passed == (outcome == "conforms")
    assert item.expanded_uncertainty_mm == pytest.approx(0.004)
    assert verdict.as_json()["figures"]["effective_diameter"]["outcome"] == outcome


def test_the_largest_is_told_beside_what_decides() -> None:
    """Bar ends 20 times 1.2 m apart; one is certified worse, so it decides with less error."""
    measured = Measured()
    measured.certify("BARS.a", "BARS.b", 300.0, 0.0)
    measured.certify("BARL.a", "BARL.b", 1200.0, 0.004)
    for i in range(20):
        bar, length, error = ("BARS", 300.0, -0.0051) if i < 10 else ("BARL", 1200.0, 0.0041)
        measured.add(f"P{i}", f"{bar}.a", (0, 0, 0))
        measured.add(f"P{i}", f"{bar}.b", (length + error * (i % 10 == 3), 0, 0))
    limits = limits_of({"volumetric_max_mm": 0.02}, uncertainty={"artefact_temperature_c": 0.0})
    verdict = judge(measured.figures(limits.uncertainty), limits)
    told = verdict.as_json()["figures"]["volumetric_max"]
    assert told["value_mm"] == pytest.approx(-0.0051)
    assert told["at"] == "P3"
    assert told["deciding_mm"] == pytest.approx(0.0041)
    assert told["deciding_at"] == "P13"
    assert told["expanded_uncertainty_mm"] == pytest.approx(0.008)
    page = make_verification_report(verdict, measured.session(), ARM, {})
    assert "-5.10" in page
    assert "+4.10" in page


def test_a_verdict_names_what_it_covers_and_why_it_fails() -> None:
    measured = Measured()
    for seat in ("SPAT1", "SPAT2", "SPAT3"):
        measured.add(seat, seat, *[(0.001 * i, 0, 0) for i in range(10)])

    def verdict(uncertainty: dict[str, float] | None = None, **mpe: float) -> Verdict:
        limits = limits_of(mpe, uncertainty=uncertainty or {})
        return judge(measured.figures(limits.uncertainty), limits)

    passed = verdict(spat_max_mm=0.02)
    assert passed.passed
    assert passed.in_words == "PASSED for SPAT max δ; not judged, having no limit: SPAT 2s"
    assert passed.as_json()["covers"] == ["spat_max"]
    assert passed.as_json()["not_judged"] == ["spat_2s"]
    failed = verdict(spat_max_mm=0.002, p_size_mm=0.01)
    assert failed.in_words.startswith(
        "FAILED: SPAT max δ: does not conform (+4.5 µm at SPAT1, MPE 2.0 µm, U not stated)"
    )
    assert any("the test's uncertainty is not stated" in remark for remark in passed.remarks)
    assert "U not stated" not in verdict(spat_max_mm=0.002, uncertainty={"seat_mm": 1e-4}).in_words
    assert "p_size: not tested, no certified length between" in failed.in_words
    page = make_verification_report(failed, measured.session(), ARM, {})
    assert "<b>NOT ACCEPTED</b>1 of 10 figures, partial test" in page
    told = "SPAT max δ does not conform: +4.50 µm of 2.00 µm permitted."
    assert told in page.replace("\N{NO-BREAK SPACE}", " ")
    assert "SPAT max δ: every result" in page and ">SPAT2<" in page and ">not stated<" in page
    assert "<b>ACCEPTED</b>1 of 10" in make_verification_report(passed, measured.session(), ARM, {})
    assert "though it has a limit</h2><ul><li>p_size: no certified length" in page
    unlimited = judge(measured.figures(), None)
    assert not unlimited.passed
    assert any("limits are in mm" in remark for remark in verdict(spat_max_mm=4.5).remarks)


@pytest.mark.parametrize(
    ("mpe", "words"),
    [
        ({}, "a limit at least, of p_size_mm"),
        ({"e_uni_mm_per_m": 0.01}, "a limit at least, of p_size_mm"),
        ({"p_size_mm": 0.02, "e_uni_mm_per_m": 0.01}, "e_uni_mm beside e_uni_mm_per_m"),
        ({"p_size_mm": 20}, "mm, 5 at most (20 µm are 0.02 mm)"),
    ],
)
def test_limits_that_would_let_everything_pass_are_refused(
    mpe: dict[str, float], words: str, tmp_path: Path
) -> None:
    file = tmp_path / "mpe.toml"
    lines = [f"{key} = {value}" for key, value in mpe.items()]
    file.write_text("\n".join(['schema = "armd.mpe/1"', "[mpe]", *lines]))
    with pytest.raises(BadInput) as refused:
        load_limits(file)
    assert words in str(refused.value)
    file.write_text('schema = "armd.mpe/1"')
    with pytest.raises(BadInput, match="mpe: found nothing"):
        load_limits(file)


def test_the_limit_of_a_length_grows_with_it() -> None:
    limits = limits_of({"e_uni_mm": 0.02, "e_uni_mm_per_m": 0.01})
    assert limits.mpe.limit_mm("e_uni", 1500.0) == pytest.approx(0.035)


@pytest.mark.parametrize(
    ("points", "radius"),
    [
        ([(0, 0, 0)], 0.0),
        ([(0, 0, 0), (2, 0, 0), (1, 0.5, 0)], 1.0),  # obtuse: the longest side
        ([(0, 0, 0), (1, 0, 0), (0.5, math.sqrt(0.75), 0)], 1 / math.sqrt(3)),
        ([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1), (0, 0, 0)], math.sqrt(3)),
    ],
)
def test_smallest_sphere(points: list[tuple[float, float, float]], radius: float) -> None:
    centre, found = find_smallest_sphere(np.array(points, float))
    assert found == pytest.approx(radius, abs=1e-12)
    assert (np.linalg.norm(np.array(points) - centre, axis=1) <= found + 1e-9).all()


def test_a_sphere_wants_points_out_of_one_plane() -> None:
    with pytest.raises(ArithmeticError):
        fit_sphere(np.array([(1.0, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)]))
