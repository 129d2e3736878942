"""The prior probability of a cause, its place, its kind and its value."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.diagnose.constants import EXPECTED_PRIOR, ROUNDING, UNKNOWN_PRIOR
from armd.compensation.effects.catalogue import CATALOGUE

#: The result of `identify_kind`: cause, location, names of columns, names of settings.
CandidateKind = tuple[str, ...]


def compute_log_prior(kinds: Sequence[CandidateKind], freedom: I64, expected: Mask) -> F64:
    """Return the log priors (C,) of candidates.

    The probability is shared among causes by their commonness, then equally among places, kinds and
    values of a grid. Candidates without *freedom* (C,) are absorbed and get −inf. Places with
    *expected* (C,) candidates have such a cause with the probability EXPECTED_PRIOR.

    A constant that shifted once is one kind; its step at one of forty instants is another. So a
    fine grid does not make its place's plain kinds improbable.
    """
    alive = np.flatnonzero(freedom > 0).tolist()
    grid = Counter(kinds[i] for i in alive)
    of_place = Counter((cause, location) for cause, location, *_ in grid)
    places = Counter(cause for cause, _ in of_place)
    common = {cause: CATALOGUE[cause].commonness for cause in places if cause != "unknown"}
    named = max(sum(common.values()), ROUNDING)
    prior = np.full(len(freedom), -np.inf)
    for i in alive:
        cause, location, *_ = kinds[i]
        named_share = (1 - UNKNOWN_PRIOR) * common.get(cause, 0.0) / named
        share = UNKNOWN_PRIOR if cause == "unknown" else named_share
        prior[i] = np.log(share / (places[cause] * of_place[cause, location] * grid[kinds[i]]))
    alive_expected = [i for i in alive if expected[i]]
    kinds_of_place = Counter(kinds[i][:2] for i in alive_expected)
    for i in alive_expected:
        prior[i] = np.log(EXPECTED_PRIOR / kinds_of_place[kinds[i][:2]])
    return prior


def find_log_prior(kind: CandidateKind, kinds: Sequence[CandidateKind], log_prior: F64) -> float:
    """Return the log prior of a finding of this *kind*.

    *log_prior* (C,) and *kinds* are those of the catalogue's candidates. The result is the prior of
    the kind or, where no candidate has this kind, the smallest one of its cause.
    """
    able = np.flatnonzero(np.isfinite(log_prior)).tolist()
    of_cause = [i for i in able if kinds[i][0] == kind[0]]
    alike = [float(log_prior[i]) for i in of_cause if kinds[i] == kind]
    unlike = [float(log_prior[i]) for i in of_cause if kinds[i] != kind]
    return max(alike) if alike else min(unlike, default=math.log(UNKNOWN_PRIOR))
