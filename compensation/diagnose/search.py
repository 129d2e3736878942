"""The search: one cause after another, each time the most probable, until nothing is wanted.

Forward by posterior among all candidates, admitted by a family-wise threshold on the score;
then a look back whether every finding is still needed and still the best name.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from armd.compensation.arm import Arm
from armd.compensation.diagnose.angles import compare
from armd.compensation.diagnose.baseline import Baseline
from armd.compensation.diagnose.evidence import Scores, Sums, add_up, score
from armd.compensation.diagnose.fit import Fit, fit
from armd.compensation.diagnose.problem import Rests
from armd.compensation.diagnose.scene import make_scene
from armd.compensation.diagnose.signatures import Signatures, compile_candidates
from armd.compensation.diagnose.threshold import effective_tests, family_wise, noise_draws
from armd.compensation.effects import catalogue
from armd.compensation.effects.effect import Candidate, Scene
from armd.compensation.effects.mount_drift import steady_drift

F64 = npt.NDArray[np.float64]

ALPHA = 0.01  # family-wise false-alarm rate on clean data
MOST_FINDINGS = 10
MOST_STEPS = 16
MOST_REFINED = 5
#: A finding is renamed when another name is so many times as probable.
CLEARLY = 10.0
MOST_RENAMINGS = 3
#: A place this much less probable than the best is still told as an alternative.
LEAST_PROBABILITY = 0.01
MOST_RIVALS = 8
MOST_COMPARED = 20
#: So is one that would leave the finding nothing significant to add.
INDISTINGUISHABLE_P = 0.01

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Rival:
    """Another cause that these data would also bear."""

    candidate: Candidate
    probability: float
    angle_deg: float  # between the projected signatures


@dataclass(frozen=True)
class Found:
    """A finding of the search, before its gain is measured."""

    candidate: Candidate
    p_value: float  # family-wise
    statistic: float
    probability: float
    rivals: tuple[Rival, ...]


@dataclass(frozen=True)
class Result:
    """What the search ends with."""

    scene: Scene
    first: Fit  # without findings
    last: Fit  # with all
    steps: tuple[Fit, ...]  # with none, the first, the first two … of the findings
    found: tuple[Found, ...]
    tests: float
    remaining_p: float  # family-wise p of the strongest candidate left out
    remaining_depends_on: tuple[str, ...]
    untold: tuple[str, ...]  # causes that these data could not show whatever their size


class Search:
    """One search over one set of rests."""

    def __init__(
        self,
        rests: Rests,
        arm: Arm,
        baseline: Baseline,
        progress: Progress = lambda _text, _share: None,
        seed: int = 1,
    ) -> None:
        self.rests = rests
        self.arm = arm
        self.baseline = baseline
        self.scene = make_scene(rests, arm, baseline)
        self._candidates = list(catalogue.candidates(self.scene))
        self._steady = [steady_drift(self.scene)] if self.scene.timed else []
        self._progress = progress
        self._seed = seed
        self._tests = 1.0
        self._signatures: Signatures | None = None
        self._parts: dict[int, tuple[Candidate, npt.NDArray[np.bool_]]] = {}
        self._own: tuple[Fit, Sums] | None = None  # the last fit's, see `_own_sums`

    def run(self) -> Result:
        """Search forward, looking back after every step."""
        first = current = self._fit([])
        sums, scores = self._survey(current)
        untold = scores.silent(set(catalogue.CATALOGUE) - {"outliers", "unknown"})
        seen: set[str] = set()
        for step in range(MOST_STEPS):
            self._progress(f"{len(current.findings)} found", step / MOST_STEPS)
            best = self._best(scores)
            if best is None or len(current.findings) >= MOST_FINDINGS:
                break
            best = self._refined(best, current, scores)
            findings = _joined(current.findings, best)
            key = "".join(sorted(repr((c.place, c.setting)) for c in findings))
            if key in seen:  # a circle: the search stays where it stands
                break
            seen.add(key)
            current = self._pruned(self._fit(findings, current))
            sums, scores = self._survey(current)
            for _ in range(MOST_RENAMINGS):
                before = current
                current, sums, scores = self._swapped(current, sums, scores)
                if current is before:
                    break
        remaining = family_wise(float(scores.log_p.min(initial=0.0)), self._tests)
        found = _honest([self._account(i, current, sums) for i in range(len(current.findings))])
        steps = [first] if current.findings else []
        steps += [self._fit(current.findings[:i], current) for i in range(1, len(found))]
        return Result(
            self.scene,
            first,
            current,
            (*steps, current),
            found,
            self._tests,
            remaining,
            scores.signatures.candidates[int(np.argmin(scores.log_p))].depends_on,
            untold,
        )

    def _fit(self, findings: Sequence[Candidate], before: Fit | None = None) -> Fit:
        """A fit that starts where *before* ended."""
        known = {}
        if before is not None:
            known = dict(zip(map(id, before.findings), before.amplitudes, strict=True))
        start = [known.get(id(c), np.zeros(len(c.columns))) for c in findings]
        model = self.baseline.model if before is None else before.model
        noise = None if before is None else before.noise
        return fit(self.rests, self.arm, self.baseline, model, findings, start, self._steady, noise)

    def _pruned(self, current: Fit) -> Fit:
        """Without findings that are not significant any more, the weakest first."""
        while len(current.findings) > 1:
            sums = self._own_sums(current)
            log_p = [
                float(score(sums, _range(at)).log_p[i])
                for i, at in enumerate(current.layout.findings)
            ]
            weakest = int(np.argmax(log_p))
            if family_wise(log_p[weakest], self._tests) < ALPHA:
                break
            kept = [c for i, c in enumerate(current.findings) if i != weakest]
            current = self._fit(kept, current)
        return current

    def _swapped(self, current: Fit, sums: Sums, scores: Scores) -> tuple[Fit, Sums, Scores]:
        """With a finding renamed where, all others given, another name is clearly likelier."""
        for i, candidate in enumerate(current.findings):
            alone = self._score(sums, current, without=i)
            places = alone.places()
            own = self._posterior_of(candidate, i, current, alone)
            best = max(places, key=lambda key: places[key])
            if best != candidate.place and places[best] > CLEARLY * own:
                rival = self._best(alone)
                if rival is None:
                    continue
                findings = [c for j, c in enumerate(current.findings) if j != i]
                without = self._fit(findings, current)
                refined = self._refined(rival, without, alone)
                current = self._pruned(self._fit(_joined(findings, refined), without))
                return current, *self._survey(current)
        return current, sums, scores

    def _survey(self, current: Fit) -> tuple[Sums, Scores]:
        """All candidates against what is left; the threshold is simulated the first time."""
        if self._signatures is None:
            self._signatures = compile_candidates(self._candidates, current.linear, self.arm)
            draws = noise_draws(current, self._seed)
        else:
            draws = None
        sums = add_up(
            current.linear,
            current.noise,
            current.residual,
            current.absorbing,
            self._signatures,
            draws,
        )
        scores = self._score(sums, current)
        if draws is not None:
            self._tests = effective_tests(scores.least_log_p)
        return sums, scores

    def _score(self, sums: Sums, current: Fit, without: int | None = None) -> Scores:
        """All candidates' scores, one finding taken out of the model.

        What is left of a curve, held to a likely size, is the curve's: parts of a finding are
        no candidates beside it.
        """
        at = range(0) if without is None else _range(current.layout.findings[without])
        held = np.zeros(len(sums.signatures.candidates), dtype=bool)
        for i, finding in enumerate(current.findings):
            if i != without:
                held |= self._parts_of(finding, sums.signatures.candidates)
        return score(sums, at).without(held)

    def _parts_of(
        self, finding: Candidate, candidates: Sequence[Candidate]
    ) -> npt.NDArray[np.bool_]:
        """(C,) which of all candidates are within a finding; kept, as it is asked often."""
        if id(finding) not in self._parts:
            inside = np.array([candidate.within(finding) for candidate in candidates])
            self._parts[id(finding)] = finding, inside
        return self._parts[id(finding)][1]

    def _best(self, scores: Scores) -> Candidate | None:
        """The most probable place among all, if anything is significant; there its best value."""
        significant = family_wise(float(scores.log_p.min(initial=0.0)), self._tests) < ALPHA
        if not significant:
            return None
        posterior = scores.log_posterior()
        places = scores.places()
        place = max(places, key=lambda key: places[key])
        of_place = [c.place == place for c in scores.signatures.candidates]
        return scores.signatures.candidates[int(np.argmax(np.where(of_place, posterior, -np.inf)))]

    def _refined(self, candidate: Candidate, current: Fit, scores: Scores) -> Candidate:
        """The best value of the non-linear parameters on a finer grid.

        The likeliest places that have such parameters are refined together: a step of the tip and
        a slip of the last joint are told apart only at the right instant.
        """
        if candidate.refine is None:
            return candidate
        finer = [candidate, *candidate.refine()]
        posterior = scores.log_posterior()
        seen = {candidate.place}
        for i in np.argsort(-posterior):
            rival = scores.signatures.candidates[i]
            if len(seen) == MOST_REFINED or not np.isfinite(posterior[i]):
                break
            if rival.refine is not None and rival.place not in seen:
                seen.add(rival.place)
                finer += [rival, *rival.refine()]
        signatures = compile_candidates(finer, current.linear, self.arm)
        fine = score(
            add_up(current.linear, current.noise, current.residual, current.absorbing, signatures)
        )
        return finer[int(np.argmax(fine.log_evidence))]

    def _own_sums(self, current: Fit) -> Sums:
        """Sums for the findings themselves as candidates."""
        if self._own is not None and self._own[0] is current:
            return self._own[1]
        signatures = compile_candidates(current.findings, current.linear, self.arm)
        sums = add_up(
            current.linear, current.noise, current.residual, current.absorbing, signatures
        )
        self._own = current, sums
        return sums

    def _posterior_of(
        self, candidate: Candidate, index: int, current: Fit, scores: Scores
    ) -> float:
        """Posterior weight of a finding's place; a refined value may be better than its grid."""
        of_place = np.array([c.place == candidate.place for c in scores.signatures.candidates])
        weight = float(np.exp(scores.log_posterior())[of_place].sum())
        if candidate.refine is not None or candidate in scores.signatures.candidates:
            return weight
        at = current.layout.findings[index]
        own = score(self._own_sums(current), _range(at))
        best = scores.log_evidence[of_place].max(initial=-np.inf)
        if not np.isfinite(best):
            return weight
        return weight * float(np.exp(np.clip(own.log_evidence[index] - best, 0.0, 500.0)))

    def _account(self, index: int, current: Fit, sums: Sums) -> Found:
        """Significance, probability and rivals of one finding, given all the others."""
        candidate = current.findings[index]
        at = current.layout.findings[index]
        own = score(self._own_sums(current), _range(at))
        scores = self._score(sums, current, without=index)
        weights = scores.places()
        weights[candidate.place] = self._posterior_of(candidate, index, current, scores)
        total = sum(weights.values())
        probability = {place: weight / total for place, weight in weights.items()}
        return Found(
            candidate,
            family_wise(float(own.log_p[index]), self._tests),
            float(own.statistic[index]),
            probability[candidate.place],
            self._rivals(candidate, probability, scores, current),
        )

    def _rivals(
        self,
        candidate: Candidate,
        probability: dict[tuple[str, str], float],
        scores: Scores,
        current: Fit,
    ) -> tuple[Rival, ...]:
        posterior = scores.log_posterior()
        rivals = []
        for place in sorted(probability, key=lambda key: -probability[key])[:MOST_COMPARED]:
            if place == candidate.place:
                continue
            of_place = [c.place == place for c in scores.signatures.candidates]
            best = int(np.argmax(np.where(of_place, posterior, -np.inf)))
            rival = _at_the_instant_of(
                candidate, of_place, scores.signatures.candidates[best], scores
            )
            rivals.append((rival, probability[place]))
        alike = compare(candidate, [rival for rival, _ in rivals], current, self.arm)
        told = [
            Rival(rival, share, likeness.angle_deg)
            for (rival, share), likeness in zip(rivals, alike, strict=True)
            if share >= LEAST_PROBABILITY
            or (likeness.left_p > INDISTINGUISHABLE_P and rival.cause != "unknown")
        ]
        return tuple(told[:MOST_RIVALS])


def _joined(findings: Sequence[Candidate], more: Candidate) -> list[Candidate]:
    """The findings with one more, which takes the place of those it contains."""
    return [*(c for c in findings if not c.within(more)), more]


def _range(at: slice) -> range:
    return range(at.start, at.stop)


def _at_the_instant_of(
    candidate: Candidate, of_place: Sequence[bool], best: Candidate, scores: Scores
) -> Candidate:
    """A rival step is compared at the finding's own, refined instant."""
    when = {name: value for name, value, _ in candidate.setting}.get("instant")
    if when is None or best.refine is None or best.setting[0][0] != "instant":
        return best
    grid = [c for c, own in zip(scores.signatures.candidates, of_place, strict=True) if own]
    steps = [c for c in grid if c.setting and c.refine is not None]

    def apart(step: Candidate) -> float:
        return abs(step.setting[0][1] - when)

    nearest = min(steps, key=apart)
    assert nearest.refine is not None
    return min([nearest, *nearest.refine()], key=apart)


def _honest(found: Sequence[Found]) -> tuple[Found, ...]:
    """No name for a part of what is unknown.

    Where an unknown structure is stronger than a named finding in the same variables, the name
    only was the nearest one.
    """
    unknown = [f for f in found if f.candidate.cause == "unknown"]

    def stands(finding: Found) -> bool:
        return not any(
            u.statistic > finding.statistic
            and set(u.candidate.depends_on) & set(finding.candidate.depends_on)
            for u in unknown
        )

    return tuple(
        f
        if f.candidate.cause == "unknown" or stands(f)
        else replace(f, candidate=replace(f.candidate, cause="unknown"))
        for f in found
    )
