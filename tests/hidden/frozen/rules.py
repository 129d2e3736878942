"""The rules of the diagnosis: what decides an answer, and is no term of the model.

Each with what stands in its place while it is switched off (`ablation.py`).
"""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np
from hidden.frozen.switches import ROOM, Rule

SEARCH = "diagnose.search."
SCORING = "diagnose.scoring."
FITTING = "diagnose.fitting."
HELDOUT = "diagnose.heldout."
DIAGNOSE = "diagnose.diagnose:"
#: Log of a p value that is significant among all candidates of an arm, about.
ABOUT_SIGNIFICANT = -16.0


def give(number: int) -> Any:
    """What stands there without the rule: the argument of that number."""
    return lambda _original, *args, **_options: args[number]


def always(value: Any) -> Any:
    return lambda _original, *_args, **_options: value


def _no_columns(_original: Any, linear: Any, *_args: Any) -> Any:
    return np.zeros((len(linear.residual), 0))


def _no_block(_original: Any, linear: Any, *_args: Any) -> Any:
    return np.zeros((len(linear.residual), 0)), np.zeros(0)


def _not_renamed(_original: Any, search: Any, current: Any, scored: Any, _tried: Any) -> Any:
    weigh = import_module(ROOM + "diagnose.search.findings").weigh_findings
    return current, scored, weigh(scored, search.survey.tests)


def _known_by_span(_original: Any, baseline: Any, *_args: Any) -> Any:
    return import_module(ROOM + "diagnose.fitting.free_expansion")._widest_k(baseline) <= 3.0


def _clipped_about_the_fit(_original: Any, residual: Any, noise: Any, fit: Any) -> Any:
    variances = import_module(ROOM + "diagnose.noise.variances")
    return variances.clip_residual(residual, fit(residual, noise), noise)


def _is_place(finding: Any) -> Any:
    return lambda candidate: candidate.place == finding.place


def _only_its_place(_original: Any, finding: Any) -> Any:
    return [_is_place(finding)]


def _as_it_is(_original: Any, candidate: Any, shape: Any) -> Any:
    if shape is None:
        return candidate
    return replace(candidate, columns=(*candidate.columns, *shape.columns))


def _one_scheme(original: Any, *args: Any) -> Any:
    confirmed = original(*args)
    return confirmed if confirmed is None or confirmed[0] == 0 else None


def _no_reason(original: Any, *args: Any) -> Any:
    required = original(*args)
    return None if required == 1.0 else required


RULES = (
    # The next cause
    Rule("the likeliest with a shape of its own", SEARCH + "selection:_choose_with_form_error",
         give(0)),
    Rule(
        "strong ones compared with their own tails", SEARCH + "selection:_with_own_tails", give(0),
        lambda result, weight, *_: int(np.argmax(result)) != int(np.argmax(weight)),
    ),
    Rule("the likelier one that few rests bear", SEARCH + "selection:_likelier", give(0)),
    Rule("clipped about the chosen one", SCORING + "robust_refit:clip_about",
         lambda _original, _candidate, projection: projection),
    Rule(
        "significant by its rests' own scatter", SCORING + "scatter:compute_log_p_by_scatter",
        always(-1e9), lambda result, *_: result > ABOUT_SIGNIFICANT,
    ),
    Rule("noise that lasts", SCORING + "noise_correlation:CorrelationEstimator.estimate",
         always(None)),
    Rule("a shape as a finding", SEARCH + "selection:choose_shape", always(None)),
    Rule(
        "many columns by their Bayes factor", values={"MOST_COUNTED": 10**9}, always=True,
    ),
    Rule(
        "explains a quarter of the best", SCORING + "evidence:Scores.find_partial_explanations",
        lambda _original, scores, _statistic: np.ones(len(scores.statistic), dtype=bool),
        always=True,
    ),
    Rule(
        "richer functions", values={"MOST_RICHER": 0}, watched_at=SEARCH + "selection:_finer",
        changed=lambda result, scores: any(
            scores.signatures.candidates[i].cause == "unknown" for i in result
        ),
    ),
    # Looking back
    Rule("without what is not significant any more", SEARCH + "survey:Survey.prune", give(1)),
    Rule("renamed where clearly likelier", SEARCH + "search:Search._rename_one",
         lambda _original, _search, current, scored: (current, scored),
         lambda result, _search, current, _scored: result[0] is not current),
    Rule("renamed at the end where less likely", SEARCH + "search:Search._rename_less_likely",
         _not_renamed, lambda result, _search, current, *_: result[0] is not current),
    Rule("refused: a certified length is lost", FITTING + "neighbourhood:find_refusal",
         always("")),
    # Other sets
    Rule("another set instead", SEARCH + "search:Search._revisited", give(1)),
    Rule(
        "a set's odds limit a probability", SEARCH + "search:limit_by_rival_sets", give(0),
        lambda result, findings, *_: any(
            a.probability != b.probability for a, b in zip(result, findings, strict=True)
        ),
    ),
    Rule(
        "one finding has no rival sets, if not free", SEARCH + "find_rival_sets:may_be_others",
        lambda _original, findings: bool(findings),
    ),
    Rule(
        "sets: six to begin with", SEARCH + "find_rival_sets:RivalSetSearch._list_starts",
        lambda original, *args: original(*args)[:1], lambda result, *_: len(result) > 1,
    ),
    Rule("sets: only as free ones barred", SEARCH + "find_rival_sets:_list_exclusions",
         _only_its_place,
         lambda result, finding: len(result) > 1 or bool(finding.instead_of)),
    Rule(
        "sets: no more amplitudes", SEARCH + "find_rival_sets:_amplitudes", always(0),
        watched_at=SEARCH + "find_rival_sets:RivalSetSearch._filled",
        changed=lambda result, rival_search, *_: sum(len(c.columns) for c in result)
        > sum(len(c.columns) for c in rival_search._fit.findings),
    ),
    Rule(
        "sets: what tells why may be less likely", SEARCH + "replacing:compute_heldout_margin",
        _no_reason, lambda result, *_: result == 1.0,
    ),
    # Shapes
    Rule("shapes absorb", SCORING + "shape:make_shape", always(None), always=True),
    Rule(
        "shifts have no shape", SCORING + "shape:_joints",
        lambda original, candidate, n: [candidate.location.joint]
        if candidate.cause == "geometry_shift" and candidate.location.joint
        else original(candidate, n),
    ),
    Rule("shapes no larger than their cause", SCORING + "candidates:_with_shape", _as_it_is,
         lambda _result, _candidate, shape: shape is not None),
    Rule("rivals have shapes, too", SEARCH + "findings:_add_gains_of_shapes", always(None),
         always=True),
    Rule("drifts stray, lags begin anyhow",
         SCORING + "time_discrepancy:make_time_discrepancy_columns",
         _no_columns, lambda result, *_: result.shape[1] > 0),
    Rule("a lag weighed with its beginnings open",
         SCORING + "time_discrepancy:has_unknown_initial_state", always(False)),
    Rule("a lag may be slower", SCORING + "time_discrepancy:make_slower", always([])),
    # What is told
    Rule("steps weighed at the finding's instant", SEARCH + "findings:_weigh_steps_at_instant",
         always({})),
    Rule("what acts through it goes with it", SCORING + "candidates:find_acting_through",
         always([])),
    Rule("no name: a rival is likelier", SEARCH + "findings:_withdraw_names",
         lambda _original, findings: tuple(findings)),
    Rule("a guess is no surer than its share", SEARCH + "findings:_limit_probability",
         lambda _original, finding, _explained: finding.probability),
    Rule("its own shape counts against it", SEARCH + "explained_share:_explains_part_of_name",
         always(False)),
    Rule("what looks back counts at its own joint only",
         SEARCH + "explained_share:_may_count_against", always(True)),
    # Older causes, growth
    Rule("a second search beside older causes", DIAGNOSE + "allow_absorbed_error", always(None),
         here_only=True),
    Rule("the second search counts instead", DIAGNOSE + "may_replace", always(False),
         here_only=True),
    Rule("unless it lost a named cause", SEARCH + "compare_searches:has_lost_cause",
         always(False)),
    Rule("constants left open by what is not written",
         HELDOUT + "open_constants:add_open_constants", give(0)),
    Rule("growth open that was not known", FITTING + "free_expansion:open_growth", give(0)),
    Rule("growth open that was guessed", FITTING + "free_expansion:_list_guessed", always(())),
    Rule("growth open that an error hid", FITTING + "free_expansion:_could_not_know",
         _known_by_span),
    Rule("growth told once all else is found", SEARCH + "growth:fit_with_growth", always(None)),
    Rule("growth that began later", SEARCH + "growth:_prefer_growth_since_calibration", give(0)),
    Rule("plain expansion without a calibration", FITTING + "expansions:make_expansion_columns",
         _no_block, lambda result, *_: result[0].shape[1] > 0),
    Rule("the first link grows", FITTING + "nuisance:_column_of_the_mount", _no_block,
         lambda result, *_: result[0].shape[1] > 0),
    Rule("the first link's growth written", "diagnose.extend:has_known_growth", always(False)),
    # Sessions, artefact
    Rule("a session that does not fit left out",
         FITTING + "under_test:make_model_and_judge_sessions",
         lambda original, *args: (original(*args)[0], None),
         lambda result, *_: result[1] is not None),
    Rule("a session explained comes back", DIAGNOSE + "_is_explained", always(False)),
    Rule("a placement parted where its artefact moved", DIAGNOSE + "find_moved_artefacts",
         lambda _original, first, _survey: ([], first), here_only=True),
    Rule(
        "a mount steps by little", SEARCH + "moved_artefact:_as_large_as_it_steps", give(0),
    ),
    Rule("gross errors clipped before a fit", "diagnose.noise.variances:clip_gross",
         _clipped_about_the_fit),
    # Held out
    Rule("repeated without what is refuted", DIAGNOSE + "select_refuted", always(()),
         here_only=True),
    Rule("only if hardly less likely", DIAGNOSE + "is_likely_beside", always(True),
         here_only=True),
    Rule("only if it predicts better", DIAGNOSE + "is_better", always(True), here_only=True),
    Rule("not written: later readings are worse", HELDOUT + "judge:Judge.predicts_later_no_worse",
         always(True)),
    Rule("deaf where one fold has it all", HELDOUT + "validation:_is_in_one_fold", always(False)),
    Rule("targets left out may decide", HELDOUT + "judge:Judge.find_confirming_scheme", _one_scheme,
         lambda result, *_: result is not None and result[0] > 0),
    Rule("gross errors count at most so much", HELDOUT + "gain:limit_squares",
         lambda _original, before, after: (before, after)),
    Rule("not written: worse over all", HELDOUT + "judge:_raises_rms_clearly", always(False)),
    Rule("without what harms among what helps together", HELDOUT + "validation:_remove_harmful",
         give(2), lambda *_: True),
    Rule("held-out readings lower the odds", HELDOUT + "judge:Judge.compute_odds_factor",
         always(1.0)),
    Rule("held to its own scale", FITTING + "neighbourhood:compute_scale_factor", always(1.0),
         lambda result, *_: abs(result - 1.0) > 1e-6),
    # The catalogue
    Rule("a coarse arm errs by more", "effects.catalogue:_coarseness", always(1.0)),
    Rule("what the calibration absorbed is no candidate", "effects.older:drop_absorbed",
         always(None)),
    Rule("each session a value of its own", "effects.by_session:make_session_functions",
         always([])),
)  # fmt: skip
