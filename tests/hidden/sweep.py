"""`make hidden-sweep CASES=n SEED=s`: how the marks move when a constant of the search is halved
and doubled; of a share, when it is halved, and its distance to one.

Every fixed constant that decides what is found stands here once, with its reason; its value stands
in `diagnose/constants.py` or, of causes, in `effects/`. The same cases are diagnosed with each
value, so that what moves is the constant's doing. `SWEEP_ARGS="--only SHAPE_OFF ALPHA"` takes some
of them.
"""

from __future__ import annotations

import argparse
import importlib
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import montecarlo
from drifts import Drifted
from marks_table import Asked, Case
from messy import MessOutcome
from montecarlo import Task
from strangers import Strange

ROOM = "armd.compensation."
FACTORS = (0.5, 2.0)


@dataclass(frozen=True)
class Constant:
    """A fixed constant of the search: the module it stands in, and why it is what it is."""

    module: str
    name: str
    why: str
    share: bool = False  # never above one

    def __str__(self) -> str:
        return f"{self.module.rsplit('.', 1)[-1]}.{self.name}"


CONSTANTS = (
    Constant("diagnose.constants", "ALPHA", "false alarms on clean data: one in a hundred"),
    Constant("diagnose.constants", "UNKNOWN_PRIOR", "one error in twenty has no name", True),
    Constant("diagnose.constants", "SHAPE_PRIOR", "a strong cause's shape is off or not"),
    Constant("diagnose.constants", "SHAPE_OFF", "discs and bearings err by 10 to 30 % in form"),
    Constant("effects.courses", "OF_A_WALK", "what wanders does so between knots, too"),
    Constant("effects.courses", "OF_A_COURSE", "no creep is quite an exponential"),
    Constant("diagnose.constants", "LEAST_UNEVEN", "what shows less is no finding"),
    Constant("effects.thermal.thermal_lag", "OF_A_LENGTH", "lengths are late by a third more"),
    Constant("diagnose.constants", "MOST_LEVERAGE", "such a rest has no residual", True),
    Constant("diagnose.constants", "MOST_COUNTED", "χ² of more columns is mostly noise"),
    Constant("diagnose.constants", "CORRELATION_SIGMAS", "one in a million sets of even noise"),
    Constant("diagnose.constants", "MOST_GAINED", "Huber's loss against the clipped"),
    Constant("diagnose.constants", "MOST_REFINED", "grids worth refining: the likeliest places"),
    Constant("diagnose.constants", "MOST_RICHER", "a rich function swallows several causes"),
    Constant("diagnose.constants", "AS_WELL", "a rich function must explain as well: e to the 10"),
    Constant(
        "diagnose.constants",
        "STRONG",
        "from nine noise units on, tails are clipped too much",
    ),
    Constant(
        "diagnose.constants",
        "LEAST_EXPLAINED_SHARE",
        "explains a quarter of what the best one does",
        True,
    ),
    Constant("diagnose.constants", "MOST_ALIKE", "kinds compared with their own tails: time"),
    Constant("diagnose.constants", "MOST_BENT", "causes tried with another shape: time"),
    Constant("diagnose.constants", "CLEARLY", "Jeffreys' strong evidence: ten times likelier"),
    Constant("diagnose.constants", "ENOUGH", "a shape half off leaves a name with 0.8", True),
    Constant("diagnose.constants", "INDISTINGUISHABLE_P", "nothing significant is left"),
    Constant("effects.setup.mount_drift", "MOST_MOUNT_STEP", "mounts step by microns"),
    Constant("diagnose.constants", "MOST_TOUCHED", "more is not now and then"),
    Constant("diagnose.constants", "RANGE_PARTS", "parts of a range with rests enough in each"),
    Constant("diagnose.constants", "MOST_RENAMINGS", "a name that changes thrice is a circle"),
    Constant("diagnose.constants", "MOST_FINDINGS", "more than ten wrongs are no diagnosis"),
    Constant("diagnose.constants", "CONTRADICTED", "names say the same with a cause"),
    Constant("diagnose.constants", "BEYOND_CHANCE", "evidence knows no size of a walk"),
    Constant("diagnose.constants", "MOST_IN_PLACE", "one cause stands for two or three"),
    Constant("diagnose.constants", "MOST_FIRST", "two are not the likeliest and another"),
    Constant(
        "diagnose.constants", "MOST_SEARCH_STEPS", "ten findings, and some renamed or refused"
    ),
    Constant("diagnose.constants", "IN_ONE", "what one placement shows, others cannot teach"),
    Constant("diagnose.constants", "MOST_SQUARES", "a gross error must not decide by itself"),
    Constant("diagnose.constants", "MOST_WORSE", "gross errors move the error over all by less"),
    Constant("diagnose.constants", "CHANGED_PRIOR", "an arm may change between two measurements"),
    Constant("identify.thermal.terms", "GROWTH_KNOWN", "a growth known to a fifth of its size"),
    Constant("effects.thermal.link_expansion", "EXPANSION_PER_K", "carbon to aluminium"),
    Constant("diagnose.constants", "MOST_FOLLOW_ROUNDS", "most cases settle in three to six"),
    Constant("diagnose.constants", "STAYS", "a tenth of what the readings tell"),
    Constant("diagnose.constants", "CURVED_SHARE", "linear to a tenth of the noise"),
    Constant("diagnose.constants", "CURVE_SCALE", "a curve's size before the data have it"),
    Constant("diagnose.constants", "MOST_SIGMAS", "three deviations of the broadest prior"),
    Constant("diagnose.fitting.neighbourhood", "MOST_OFF", "a certified length is lost"),
    Constant("diagnose.constants", "CLEARLY_MORE", "less is what a length moves by"),
    Constant("diagnose.constants", "STANDS_OUT", "a growth is twice what hides it"),
    Constant("diagnose.constants", "LEAST_TAKEN_UP", "less than one noise unit is nothing"),
    Constant("diagnose.constants", "LEFT_OUT_PARTS", "about as many as there are constants"),
    Constant("diagnose.constants", "STEP_P", "one in a thousand sets of noise"),
    Constant("diagnose.constants", "KNOT_S", "a base wanders in minutes, not in seconds"),
    Constant("diagnose.constants", "GROSS", "a gross error is four noise units off"),
    Constant("diagnose.constants", "MOST_FREE_COLUMNS", "more amplitudes share a size"),
    Constant("diagnose.constants", "MOST_INSTANTS", "instants of the first, coarse grid"),
    Constant("diagnose.constants", "PAUSE", "a pause of ten usual ones parts sessions"),
    Constant("effects.largest", "ANGLE_RAD", "a disc of 50 mm that sits 0.1 mm off its axis"),
    Constant("effects.largest", "COMPLIANCE_RAD_PER_NM", "by 100 Nm a joint would turn by 7°"),
    Constant("effects.largest", "GROWTH_PER_K", "ten times what plastics grow by"),
    Constant("effects.courses", "LEAST_DAYS", "less of a day than this looks like a curve"),
    Constant("effects.courses", "LEAST_PIECES", "a walk's pieces where sessions are few"),
)


@contextmanager
def changed(constant: Constant, factor: float) -> Iterator[float | int]:
    """Every module that has the constant sees it multiplied, a count rounded to at least one; a
    share comes so much nearer to one."""
    origin = importlib.import_module(ROOM + constant.module)
    value = getattr(origin, constant.name)
    other = max(1, round(value * factor)) if isinstance(value, int) else value * factor
    if constant.share and factor > 1.0:
        other = 1.0 - (1.0 - value) / factor
    having = [m for name, m in sorted(sys.modules.items()) if _has(name, m, constant)]
    for module in having:
        setattr(module, constant.name, other)
    try:
        yield other
    finally:
        for module in having:
            setattr(module, constant.name, value)


def _has(name: str, module: object, constant: Constant) -> bool:
    if name == ROOM + constant.module:
        return True
    file = getattr(module, "__file__", None)
    if not name.startswith(ROOM) or file is None or not hasattr(module, constant.name):
        return False
    origin = re.escape(ROOM + constant.module)
    taken = rf"from {origin} import (\([^)]*\b|.*\b){constant.name}\b"
    return re.search(taken, Path(file).read_text(encoding="utf-8")) is not None


def right(outcome: Case) -> bool:
    """Whether all that was planted is named, and nothing else."""
    if isinstance(outcome, Asked):
        return outcome.resolved
    if isinstance(outcome, Drifted | MessOutcome | Strange):
        return outcome.right
    if outcome.kind == "unknown":
        return bool(outcome.unknown) and not outcome.false_causes
    silent = bool(outcome.truths) or not outcome.places
    return all(outcome.named) and not outcome.false_causes and silent


def sure_and_wrong(outcome: Case) -> bool:
    """Whether something that was not planted is told as sure, where the kind says so."""
    if isinstance(outcome, Drifted | MessOutcome | Strange):
        return bool(outcome.sure_and_wrong)
    return False


def marks(tasks: Sequence[Task]) -> tuple[int, int, int, float]:
    """How many are right, how many tell something sure and wrong, how many extended models are
    worse by over 0.2 %, and by how much the held-out error of all together stands over the
    oracle's, where one is known."""
    outcomes = [o for o in map(montecarlo.carry_out, tasks) if o is not None]
    judged = [o for o in outcomes if not isinstance(o, Asked)]
    worse = sum(o.after_um > 1.002 * o.before_um for o in judged)
    known = [o for o in judged if not isinstance(o, MessOutcome)]
    after, best = sum(o.after_um**2 for o in known), sum(o.oracle_um**2 for o in known)
    over = (after / best) ** 0.5 - 1.0 if best else 0.0
    return sum(map(right, outcomes)), sum(map(sure_and_wrong, outcomes)), worse, over


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=4, help="of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="+", default=["single", "pair", "gaussian", "drift"],
                        choices=montecarlo.KINDS, metavar="KIND")  # fmt: skip
    parser.add_argument("--only", nargs="+", metavar="NAME", help="only these constants")
    args = parser.parse_args()
    tasks = [
        Task(kind, 1_000_000 * args.seed + 10_000 * montecarlo.KINDS.index(kind) + j)
        for kind in args.kinds
        for j in range(args.cases)
    ]
    row = "{:34s} {:>10s}  {:>12s} {:>10s} {:>6s} {:>18s}   {}"
    print(row.format("constant", "value", "right", "sure+wrong", "worse", "over the oracle", "why"))

    def tell(name: str, value: str, why: str = "") -> None:
        good, wrong, worse, over = marks(tasks)
        told = (f"{good} of {len(tasks)}", str(wrong), str(worse), f"{100 * over:.1f} %")
        print(row.format(name, value, *told, why), flush=True)

    tell("as they are", "")
    for constant in CONSTANTS:
        if args.only and constant.name not in args.only:
            continue
        for factor in FACTORS:
            with changed(constant, factor) as value:
                tell(str(constant), f"{value:.4g}", constant.why if factor < 1.0 else "")
    return 0


if __name__ == "__main__":
    sys.exit(main())
