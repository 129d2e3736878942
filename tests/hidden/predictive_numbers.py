"""`make hidden-predictive CASES=n SEED=s`: is the planted cause's own variable first?

For each cause n cases, and n clean ones for every two causes. The first entry of `predictive`, what
stands out of noise most, must be over a variable of the planted cause (`own_variables`, what
physics says) in cases of over 8 noise units. Where that case's readings cannot tell the first
entry's variable from one of the cause's (its `alike`: temperatures and time that rise together in
sessions that only warm), no order of theirs is right: such a case is counted by itself. And in
clean cases, and after the extension of those that were named, the smallest p-value must not be
below 0.05 divided by the number of entries more often than by chance.
`HIDDEN_ARGS="--only self_heating --design standard"` takes some causes, or the larger design.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import traceback
from collections import Counter
from dataclasses import dataclass

import numpy as np
from cases import at_most, run_case

from armd.compensation.diagnose.predictive.curves import compare
from armd.simulator.campaigns.hidden import Design
from armd.simulator.plants.causes import CAUSES
from armd.simulator.plants.draw import draw_plant
from armd.simulator.plants.plant import Plant

SMALL = Design(sessions=6, articulations=3, holdout=1)
LEAST_SNR = 8.0
FACTOR = (0.3, 1.0)  # of the typical size, its logarithm
#: Their typical size is a few noise units in the small design: planted so many times as large.
WEAK = ("nonlinear_expansion", "artefact_length", "gear_mesh", "artefact_expansion", "thermal_lag",
        "mount_drift")  # fmt: skip
LARGER = 2.5
#: Bad readings go by no variable, and what is outside the catalogue by its own.
WITHOUT = ("outliers", "unknown")


def own_variables(plant: Plant) -> set[str]:
    """The variables that a planted cause acts through, by physics."""
    at = plant.location.split()[-1]
    angles = {f"q{k}" for k in range(2, 10)}
    match plant.cause:
        # A disc is read, and a journal turns, by its own joint's angle.
        case ("encoder_eccentricity" | "encoder_ellipticity" | "encoder_periodic"
              | "encoder_scale" | "axis_wobble"):  # fmt: skip
            return {f"q{at}"}
        case "encoder_thermal":  # a disc that warms on one side
            return {f"q{at}", f"t{at}"}
        case "gear_mesh":  # teeth of the joint, or of the neighbour that drives it
            return {f"q{int(at) + k}" for k in (-1, 0, 1)}
        # Which flank bears, and how late an angle is, go by the rate.
        case "joint_backlash" | "time_skew":
            return {f"w{at}"}
        case "self_heating":  # by the rate that warms it, with a delay
            return {f"w{at}", "time_s"}
        # A weight's moment goes by all angles that tilt or stretch what hangs on it; not by the
        # first, about the vertical.
        case "joint_compliance" | "link_bending" | "stylus_sag":
            return angles
        case "probing_force":
            return {"approach"}
        case "joint_thermal" | "link_expansion" | "nonlinear_expansion":
            return {f"t{at}"}
        case "thermal_lag":  # what the link still has of before
            return {f"t{at}", "time_s"}
        case "thermal_gradient":  # the simulator's bows by the difference to the next link
            return {f"t{at}", f"t{int(at) + 1}"}
        # The links on the sensor are wrong by the same at every temperature: since the calibration,
        # and as a constant of a joint is, below.
        case "sensor_offset":
            link = int(at.removeprefix("t"))
            return {at, "time_s", f"q{link}", f"q{link + 1}"}
        case "sensor_swapped":
            return {*plant.location.removeprefix("sensors ").split(", ")}
        # A constant of a joint is the same since an instant, or the calibration; along the motion
        # of the joint before it it turns with its own angle, of those after it with the next one.
        case "geometry_shift":
            return {"time_s", f"q{at}", f"q{int(at) + 1}"}
        case "encoder_slip" | "mount_drift" | "tip_offset":
            return {"time_s"}
        case "artefact_expansion":
            return {"artefact_c"}
        case "artefact_length":
            return {"target"}
        case "artefact_sag":  # by where a target is, and how the artefact leans
            return {"placement", "target"}
    raise KeyError(plant.cause)


@dataclass(frozen=True)
class Task:
    cause: str  # "clean": none
    seed: int
    design: Design


@dataclass(frozen=True)
class Numbers:
    """Of one case."""

    task: Task
    plant: Plant | None
    snr: float
    named: bool
    first: tuple[str, str]  # variable and component of the first entry
    alike: tuple[str, ...]  # variables that the readings cannot tell from the first one's
    least_p: tuple[float, float]  # before and after, times the number of entries

    @property
    def is_own(self) -> bool:
        return self.plant is not None and self.first[0] in own_variables(self.plant)

    @property
    def is_tied(self) -> bool:
        """Not its own, but no other by these readings."""
        own = own_variables(self.plant) if self.plant else set()
        return not self.is_own and not own.isdisjoint(self.alike)

    @property
    def verdict(self) -> str:
        if self.plant is None:
            return ""
        if self.is_own:
            return "own"
        return "tied" if self.is_tied else "OTHER"


def carry_out(task: Task) -> Numbers | None:
    """One case; a failure is told and counted."""
    try:
        rng = np.random.default_rng([task.seed, 0x9ED1C])
        plants, held = [], None
        if task.cause == "clean":
            held = task.seed // 2 % 2 == 1
        else:
            factor = float(np.exp(rng.uniform(*FACTOR)))
            factor *= LARGER if task.cause in WEAK else 1.0
            plants = [draw_plant(rng, [task.cause], factor)]
        judged = run_case(task.seed, plants, held=held, design=task.design)
        every = compare(judged.diagnosis)
        least = [len(every) * min(c.p_value for c in curves)
                 for curves in ([e.before for e in every], [e.after for e in every])]  # fmt: skip
        return Numbers(
            task,
            plants[0] if plants else None,
            judged.snr[0] if plants else 0.0,
            all(judged.named),
            (every[0].bins.variable, every[0].component.name),
            every[0].bins.alike,
            (least[0], least[1]),
        )
    except Exception:
        traceback.print_exc(file=sys.stderr)
        return None


def tell(found: Numbers) -> str:
    where = f"{found.plant.cause} {found.plant.location}" if found.plant else "clean"
    first = f"{found.first[1]} over {found.first[0]}"
    return (
        f"{found.task.seed} {where}, {found.snr:.1f} noise units: {first} {found.verdict}; "
        f"smallest p × entries {found.least_p[0]:.2f}, after {found.least_p[1]:.2f}"
    )


def table(found: list[Numbers]) -> None:
    counted = [one for one in found if one.plant is not None and one.snr > LEAST_SNR]
    cases = Counter(one.task.cause for one in counted)
    right = Counter(one.task.cause for one in counted if one.is_own)
    tied = Counter(one.task.cause for one in counted if one.is_tied)
    for cause in sorted(cases):
        print(f"{cause:24s} {right[cause]} first, {tied[cause]} tied, of {cases[cause]}")
    print(f"own variable first: {right.total()} of {cases.total()}; tied with it: {tied.total()}")
    for name, of, place in (
        ("clean", [one for one in found if one.plant is None], 0),
        ("after the extension", [one for one in found if one.plant is not None and one.named], 1),
    ):
        below = sum(one.least_p[place] < 0.05 for one in of)
        print(f"{name}, smallest p below 0.05 / entries: {at_most(below, len(of))}")


def tasks_of(args: argparse.Namespace) -> list[Task]:
    design = Design() if args.design == "standard" else SMALL
    causes = [cause for cause in CAUSES if cause not in WITHOUT]
    return [
        task
        for j in range(args.cases)
        for i, cause in enumerate(causes)
        if not args.only or cause in args.only
        for task in (
            Task(cause, 1_000_000 * args.seed + 1000 * i + j, design),
            *[Task("clean", 1_000_000 * args.seed + 500_000 + 100 * j + i, design)] * (i % 2 == 0),
        )
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=5, help="of each cause")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--design", choices=("small", "standard"), default="small")
    parser.add_argument("--only", nargs="+", metavar="CAUSE", help="only these causes")
    args = parser.parse_args()
    tasks, found = tasks_of(args), []
    with multiprocessing.get_context("spawn").Pool(args.workers) as pool:
        for one in pool.imap_unordered(carry_out, tasks):
            if one is not None:
                found.append(one)
                print(tell(one), flush=True)
    table(found)
    return 0 if len(found) == len(tasks) else 1


if __name__ == "__main__":
    sys.exit(main())
