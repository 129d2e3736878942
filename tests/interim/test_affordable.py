"""A change that may have been many growths of many bends still makes a calibration that armd reads:
once it was refused as too large a file, after the check was kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_interim_history import true_calibration

from armd.compensation.interim.changes.change import Change, ChangeScenario
from armd.compensation.interim.checks.columns import Cause, list_causes
from armd.compensation.interim.evidence.stack import Stack
from armd.compensation.interim.report.amend import extend_calibration
from armd.compensation.interim.report.average import (
    MOST_ROWS,
    _list_terms,
    choose_affordable,
    compute_average,
)
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import Calibration, load_calibration, save_calibration
from armd.errors import BadInput
from armd.simulator.truth import nominal

CHECKS, NUMBERS = 40, 3
#: The first instant of all.
BEGUN_UNIX_S = 1.77e9


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.toml").write_text(nominal.make_arm_toml())
    true_calibration(folder)
    return folder


@pytest.fixture(scope="module")
def calibration(folder: Path) -> Calibration:
    return load_calibration(folder / "calibration.json").content


@pytest.fixture(scope="module")
def causes(folder: Path, calibration: Calibration) -> list[Cause]:
    return list_causes(load_arm(folder / "arm.toml"), calibration)


def a_stack(causes: list[Cause]) -> Stack:
    rng = np.random.default_rng(1)
    ends = np.cumsum([len(cause.candidate.columns) for cause in causes])
    starts = [0, *ends[:-1]]
    return Stack(
        np.arange(float(CHECKS)),
        tuple(rng.normal(size=NUMBERS) for _ in range(CHECKS)),
        tuple(rng.normal(size=(NUMBERS, int(ends[-1]))) for _ in range(CHECKS)),
        tuple(rng.normal(size=(NUMBERS, 2)) for _ in range(CHECKS)),
        tuple(np.zeros((NUMBERS, 0)) for _ in range(CHECKS)),
        tuple(slice(int(a), int(b)) for a, b in zip(starts, ends, strict=True)),
    )


def a_growth(causes: list[Cause], cause: int, first: int) -> Change:
    rate = np.ones(len(causes[cause].candidate.columns))
    bends = tuple(float(at) for at in range(3, CHECKS, 3) if at > first)
    return Change(cause, True, first, first, first, first - 1.0, np.nan, bends_d=bends,
                  rate_size=rate)  # fmt: skip


def written(
    path: Path, of: Stack, causes: list[Cause], calibration: Calibration, ways: list[ChangeScenario]
) -> Calibration:
    every = compute_average(of, causes, ways, ())
    instants = [BEGUN_UNIX_S] * len(every.changes)
    made = extend_calibration(calibration, BEGUN_UNIX_S, causes, every.changes, instants,
                   every.amplitudes, BEGUN_UNIX_S + 86400.0 * CHECKS, {})  # fmt: skip
    return save_calibration(path, made).content


@pytest.mark.slow
def test_sixty_growths_in_doubt_make_a_calibration_that_is_read(
    causes: list[Cause], calibration: Calibration, tmp_path: Path
) -> None:
    of = a_stack(causes)
    ways = [(0.9**k, (a_growth(causes, k % len(causes), 2 + k % 5),)) for k in range(60)]
    with pytest.raises(BadInput, match="values, expected 100000 at most"):
        total = sum(share for share, _ in ways)
        every = [(share / total, way) for share, way in ways]
        written(tmp_path / "all.json", of, causes, calibration, every)
    kept = choose_affordable(ways, causes, len(calibration.covariance_of))
    assert sum(share for share, _ in kept) == pytest.approx(1.0)
    assert [way for _, way in kept] == [way for _, way in ways[: len(kept)]] and len(kept) > 1
    made = written(tmp_path / "some.json", of, causes, calibration, kept)
    assert len(made.covariance_of) <= MOST_ROWS
    # And so in the epochs to come, each under the calibration of the one before.
    for epoch in range(4):
        kept = choose_affordable(ways, causes, len(made.covariance_of))
        made = written(tmp_path / f"{epoch}.json", of, causes, made, kept)


def test_one_way_that_is_too_large_by_itself_goes_straight(
    causes: list[Cause], calibration: Calibration, tmp_path: Path
) -> None:
    largest = max(range(len(causes)), key=lambda k: len(causes[k].candidate.columns))
    way = tuple(a_growth(causes, (largest + k) % len(causes), 2 + k) for k in range(5))
    ((share, straight),) = choose_affordable([(0.4, way)], causes, 150)
    assert share == 1.0
    assert all(change.gradual and change.bends_d == () for change in straight)
    made = written(tmp_path / "c.json", a_stack(causes), causes, calibration, [(1.0, straight)])
    assert len(made.covariance_of) <= MOST_ROWS


def test_few_ways_stay_as_they_are(causes: list[Cause]) -> None:
    ways = [(0.75, (Change(0, False, 3, 3, 3, 2.0, 0.75),)), (0.25, (a_growth(causes, 1, 2),))]
    assert choose_affordable(ways, causes, 33) == ways


def test_a_growth_of_many_bends_keeps_every_second_or_fourth(
    causes: list[Cause],
) -> None:
    bends = tuple(float(3 * k) for k in range(1, 140))
    few = min(range(len(causes)), key=lambda k: len(_list_terms(a_growth(causes, k, 2), causes)))
    long = replace(a_growth(causes, few, 2), bends_d=bends, bending=0.4)
    ((share, (coarse,)),) = choose_affordable([(0.4, (long,))], causes, 33)
    assert share == 1.0 and coarse.gradual and coarse.rate_size is long.rate_size
    step = (len(bends) + len(coarse.bends_d) - 1) // len(coarse.bends_d)
    assert step in (2, 4, 8, 16) and coarse.bends_d == bends[::-1][::step][::-1]
    assert coarse.bending == pytest.approx(0.4 * step**0.5)
    assert (
        len(_list_terms(coarse, causes)) <= (MOST_ROWS - 33) // 2 < len(_list_terms(long, causes))
    )
    # One of few bends beside it stays as it is.
    short = a_growth(causes, few + 1, 2)
    assert choose_affordable([(0.6, (long, short))], causes, 33)[0][1][1] == short
