"""Causes of other packages: what their code raises, or what an arm has not, is told once."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from armd.compensation.effects import location
from armd.compensation.effects.added import _checked
from armd.compensation.effects.effect import Candidate, Column, Effect, SessionFacts, tie
from armd.compensation.model.pose_factors import Angle
from armd.errors import BadInput
from armd.plugins.entry_points import Plugin, report
from support.other_packages import environment_with, install_template
from support.program import run_armd
from support.whole_scene import whole_scene

PLUGIN = Plugin("armd.causes", "odd", "odd 1.0", EntryPoint("odd", "odd:EFFECT", "armd.causes"))
N_JOINTS = 6


@pytest.fixture(scope="module")
def facts() -> SessionFacts:
    return whole_scene().held


def candidate(joint: int = 2, typical: float = 1e-5, parameter: str = "theta_1") -> Candidate:
    column = Column("pull", "rad per rad", typical, tie([(parameter, 1.0)], Angle(joint=joint)))
    return Candidate("odd", location.joint(1), (column,), ("q2",))


def effect(*given: Candidate | Exception) -> Effect:
    def candidates(facts: SessionFacts) -> Iterator[Candidate]:
        for one in given:
            if isinstance(one, Exception):
                raise one
            yield one

    def reading(candidate: Candidate, amplitudes: object) -> str:
        raise IndexError("no amplitude")

    return Effect("odd", "it is odd", "", "look again", candidates, reading)


def made(facts: SessionFacts, *given: Candidate | Exception) -> list[Candidate]:
    return list(_checked(PLUGIN, effect(*given)).candidates(facts))


def test_a_sound_cause_is_what_it_was(facts: SessionFacts) -> None:
    assert made(facts, candidate(), candidate(3)) == [candidate(), candidate(3)]


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (ValueError("no such arm"), "armd.causes odd: found ValueError: no such arm, expected"),
        (
            candidate(N_JOINTS + 1),
            "odd 1.0: terms[1].basis: found joint 7, expected a joint of 1…6",
        ),
        (candidate(parameter="theta_9"), "terms[1].parameter: found 'theta_9', expected a param"),
        (candidate(typical=0.0), "armd.causes odd: found the typical size 0.0 of pull, expected a"),
        (replace(candidate(), cause="link_bending"), "expected a Candidate of 'odd'"),
    ],
)
def test_a_cause_that_is_not_sound_has_no_candidate(
    facts: SessionFacts, capsys: pytest.CaptureFixture[str], wrong: Candidate | Exception, told: str
) -> None:
    report.cache_clear()
    for _ in range(3):
        assert made(facts, candidate(), wrong) == []
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and told in said


def test_a_finer_grid_is_held_to_the_same(
    facts: SessionFacts, capsys: pytest.CaptureFixture[str]
) -> None:
    report.cache_clear()

    def at(value: float) -> Candidate:
        raise OverflowError(value)

    good = replace(candidate(), refine=lambda: [candidate(3)], elsewhere=at)
    (found,) = made(facts, good)
    assert found.refine is not None and found.refine() == [candidate(3)]
    assert found.elsewhere is not None and found.elsewhere(2.0) == good
    assert "OverflowError: 2.0" in capsys.readouterr().err
    (found,) = made(facts, replace(candidate(), refine=lambda: [candidate(N_JOINTS + 1)]))
    assert found.refine is not None and found.refine() == []


def test_a_text_that_fails_is_the_cause_s_reason(
    capsys: pytest.CaptureFixture[str],
) -> None:
    report.cache_clear()
    guarded = _checked(PLUGIN, effect(candidate()))
    assert guarded.describe(candidate(), np.ones(1)) == "joint 1: it is odd"
    assert "IndexError: no amplitude" in capsys.readouterr().err


def test_another_name_than_the_entry_points_is_refused() -> None:
    with pytest.raises(BadInput, match=r"found the cause 'other', expected the entry point's own"):
        _checked(PLUGIN, replace(effect(), cause="other"))


#: An arm whose joint 2 turns by 2e-4 rad per radian of joint 3 beyond what its encoder says.
DIAGNOSE = """
import sys
from pathlib import Path
import armd
from support.measured_arm import measured_arm
measured = measured_arm(Path(sys.argv[1]), readings=150, placements=6)
measured.columns["q2"] = measured.columns["q2"] - 2e-4 * measured.columns["q3"]
session = armd.make_session(measured.columns, measured.arm_file, artefact=measured.artefact)
diagnosis = armd.diagnose([session], measured.arm_file)
for found in diagnosis.findings:
    print(found.cause, found.location, found.parameters[0].value, sep=" | ")
diagnosis.extended.save("extended.json")
"""


@pytest.mark.slow
def test_the_template_s_cause_is_found_where_it_was_planted(tmp_path: Path) -> None:
    """Its extended calibration is of use where the package is not installed."""
    installed = install_template(tmp_path)
    environment = environment_with(installed)
    environment["PYTHONPATH"] += f":{Path(__file__).parents[1]}"
    command = [sys.executable, "-c", DIAGNOSE, str(tmp_path)]
    done = subprocess.run(
        command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True
    )
    (found,) = done.stdout.splitlines()
    cause, place, pull = found.split(" | ")
    assert (cause, place) == ("cable_pull", "joint 2")
    assert float(pull) == pytest.approx(2e-4, abs=2e-6)
    assert run_armd("check", "arm.toml", "extended.json", cwd=tmp_path).returncode == 0
