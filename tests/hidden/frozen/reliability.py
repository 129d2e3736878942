"""`make hidden-reliability SEEDS=421,… [HEAD=REV]`: how far a diagnosis' certainty can be believed.

Over the answers to frozen cases, which are taken from the cache or run: the probability of a cause
and of a set against the share that is right, the interval of a size against what was planted, and
the held-out error and gain that were promised against what sessions show that took no part. A
finding is right if it names a planted cause at its place, or is true of how it was measured; a set
is right if all its findings are and no due cause is missing, and has the product of its findings'
probabilities. Planted into real robots, whose other errors nobody knows, is left out.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from hidden.frozen.case import Truth, read_truth
from hidden.frozen.compare import find_answers
from hidden.frozen.freeze import CACHE, ROOT, wanted_cases
from hidden.frozen.revision import check_out, commit_of
from hidden.frozen.run import Ran
from hidden.frozen.score import find_relation, is_name, score
from scipy.stats import binomtest

Answer = tuple[Truth, Ran]
#: (reported probability, whether it was right)
Claim = tuple[float, bool]
EDGES = (0.0, 0.5, 0.8, 0.95, 0.99, 1.0)
#: Findings that are no causes in the arm, and in no set of causes.
NOT_IN_SETS = ("artefact_moved", "outliers")
RIGHT = ("own", "neutral")
ARC_SECOND = np.pi / 180 / 3600
#: Causes whose planted size is one amplitude of the report: its unit in the report's.
SIZES = {
    "encoder_ellipticity": ARC_SECOND, "encoder_periodic": ARC_SECOND, "gear_mesh": ARC_SECOND,
    "encoder_scale": ARC_SECOND, "joint_backlash": ARC_SECOND, "joint_thermal": ARC_SECOND,
    "joint_compliance": 1e-6, "link_bending": 1e-6, "link_expansion": 1e-6,
    "nonlinear_expansion": 1e-6, "stylus_sag": 1e-3, "time_skew": 1e-6,
}  # fmt: skip
#: Kinds whose words end with each cause's size.
SIZED = ("single", "pair", "crowd", "faint", "thermal-1", "thermal-2", "thermal-4")
SIGMAS = 1.959964


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", required=True, help="of frozen cases, separated by commas")
    parser.add_argument("--head", default="HEAD", help="the revision that is asked")
    parser.add_argument("--cases", type=int, help="of each kind at most")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    args = parser.parse_args()
    revision = check_out(ROOT, commit_of(ROOT, args.head), CACHE / "revisions")
    answers: list[Answer] = []
    for seed in (int(one) for one in args.seeds.split(",")):
        cases = wanted_cases(most=args.cases)
        (ran,) = find_answers([revision], cases, seed, args.workers)
        answers += [(read_truth(CACHE / str(seed) / c.name), ran[c.name]) for c in cases]
    print("\n".join(make_tables([one for one in answers if one[0].count_foreign])))
    return 0


def make_tables(answers: Sequence[Answer]) -> Iterator[str]:
    """Yield the lines of all tables."""
    refused = sum(bool(ran.refused) for _, ran in answers)
    yield f"{len(answers)} cases, of which {refused} were refused\n"
    causes = [claim for answer in answers for claim in list_causes(*answer)]
    sets = [claim for answer in answers for claim in list_sets(*answer)]
    for title, claims in (("causes", causes), ("sets", sets)):
        yield f"{title:8s} {'reported':>12s} {'mean':>6s} {'right':>11s} {'share, 95 %':>22s}"
        yield from _count_in_bins(claims)
    held = [inside for answer in answers for inside in list_sizes(*answer)]
    yield f"\n95 % intervals of sizes that hold what was planted: {_share(sum(held), len(held))}"
    promises = [ratio for answer in answers for ratio in list_promises(*answer)]
    low, middle, high = np.percentile(promises, [5, 50, 95]) if promises else [np.nan] * 3
    yield (
        f"held-out RMS of later sessions, of the promised one ({len(promises)}): "
        f"{middle:.2f}; 90 % lie from {low:.2f} to {high:.2f}"
    )
    gains = [one for answer in answers for one in list_gains(*answer)]
    inside, width = sum(holds for holds, _ in gains), np.median([w for _, w in gains] or [np.nan])
    yield (
        f"95 % intervals of the gain in another session that hold it: {_share(inside, len(gains))}"
        f"; as wide as {width:.1f} gains (median)"
    )


def list_causes(truth: Truth, ran: Ran) -> Iterator[Claim]:
    """Yield each finding's probability, and whether it is right."""
    for finding in ran.findings:
        yield float(finding["probability"]), find_relation(truth, finding) in RIGHT


def list_sets(truth: Truth, ran: Ran) -> Iterator[Claim]:
    """Yield the reported set's probability, and whether it is right; nothing without findings."""
    if not ran.findings:
        return
    claims = list(list_causes(truth, ran))
    scored = score(truth, ran)
    complete = scored.named == scored.due
    is_right = complete and all(right for _, right in claims)
    if ran.set_probability is not None:
        beside = [float(f["probability"]) for f in ran.findings if f["cause"] in NOT_IN_SETS]
        yield ran.set_probability * float(np.prod(beside)), is_right
    else:  # by a revision that tells none
        yield float(np.prod([p for p, _ in claims])), is_right


def list_sizes(truth: Truth, ran: Ran) -> Iterator[bool]:
    """Yield of each size that can be compared whether its 95 % interval holds what was planted."""
    if truth.kind not in SIZED:
        return
    for words, cause in zip(truth.words.split(": ")[-1].split(" + "), truth.causes, strict=False):
        planted = words.rpartition(" ")[2]
        findings = [f for f in ran.findings if is_name(cause, f) and _has_amplitude(f)]
        if cause.cause in SIZES and findings and _is_number(planted):
            size, uncertainty = _amplitude(findings[0])
            missed = size - abs(float(planted)) * SIZES[cause.cause]
            yield bool(abs(missed) <= SIGMAS * uncertainty)


def list_promises(truth: Truth, ran: Ran) -> Iterator[float]:
    """Yield the later sessions' error under the extended model, of what was promised."""
    if ran.promised_um and ran.findings and ran.after_um is not None and not truth.holdout_given:
        yield ran.after_um / ran.promised_um[1]


def list_gains(truth: Truth, ran: Ran) -> Iterator[tuple[bool, float]]:
    """Yield whether the interval of the extended model's gain in another session holds what later
    sessions gain, and its width over that gain."""
    if ran.later_gain_um is None or ran.before_um is None or ran.after_um is None:
        return
    low, high = ran.later_gain_um
    gained = ran.before_um - ran.after_um
    yield bool(low <= gained <= high), (high - low) / abs(gained)


def _amplitude(finding: Mapping[str, Any]) -> tuple[float, float]:
    """Of a size with one or two components, and its standard uncertainty."""
    fitted = _list_fitted(finding)
    values = np.array([one["value"] for one in fitted])
    uncertainties = np.array([one["standard_uncertainty"] for one in fitted])
    size = float(np.linalg.norm(values))
    return size, float(np.linalg.norm(values * uncertainties) / size)


def _list_fitted(finding: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Its fitted parameters; one that was scanned, as an order, has no uncertainty."""
    return [one for one in finding["parameters"] if one["standard_uncertainty"]]


def _has_amplitude(finding: Mapping[str, Any]) -> bool:
    """Whether its size is one amplitude: no RMS of a curve, no polynomial."""
    fitted = _list_fitted(finding)
    one_unit = len({one["unit"] for one in fitted}) == 1
    return one_unit and all(one["name"] != "rms" for one in fitted)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _count_in_bins(claims: Sequence[Claim]) -> Iterator[str]:
    for low, high in pairwise(EDGES):
        inside = [(p, right) for p, right in claims if low <= p < high or (p == high == EDGES[-1])]
        if inside:
            mean, right = np.mean([p for p, _ in inside]), sum(right for _, right in inside)
            reported = f"{low:.2f}–{high:.2f}"
            yield f"{'':8s} {reported:>12s} {mean:6.3f} {_share(right, len(inside)):>34s}"


def _share(count: int, of: int) -> str:
    if not of:
        return "none"
    interval = binomtest(count, of).proportion_ci(0.95)
    return f"{count} of {of}, {count / of:.3f} ({interval.low:.2f} to {interval.high:.2f})"


if __name__ == "__main__":
    sys.exit(main())
