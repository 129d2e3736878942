"""Cases beyond one clean cause under a plain calibration, and whether what is said is right.

"stranger": what the catalogue knows in no form, or since lately; "crowd": four or five causes at
once, every other time all at one joint; "again": diagnosed for the third time, each time under the
calibration that armd wrote before; "real": planted into what a real arm's encoders said, after it
was diagnosed once; "offset", "exchanged", "late": a sensor that reads wrong, that has another's
place, or that its link follows late, and a cause that goes by it; "ramped": a link that grows
more than its calibration says and follows its sensor late, half of the sessions begun on a ramp;
"bent": the same of a link that bends by a gradient.
"""

from __future__ import annotations

import functools
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from cases import HELD, at_most, projected_snr
from real.convert import ball_in_socket, ur10
from told_apart import told_apart

from armd.compensation.data.sessions.session import Session, load_session
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.kinematics import compute_pose
from armd.simulator.campaigns.hidden import Design
from armd.simulator.plants.causes import CAUSES
from armd.simulator.plants.draw import FOREIGN_SIZE, draw_plant
from armd.simulator.plants.plant import Plant, list_columns
from support.made_case import make_case
from support.planting import Effect, middle_unix_s, of_joint, planted, rms_um, slip, wave

KINDS = (
    "stranger", "crowd", "again", "real", "alien", "offset", "exchanged", "late", "ramped", "bent",
)  # fmt: skip
NAMELESS = ("stranger", "alien")
SURE, SEEN = 0.95, 8.0
DESIGN = Design(sessions=6, articulations=4, holdout=2)
RAMPED = replace(DESIGN, ramp_k_per_h=8.0, ramps=3)
#: With a file of their own since they were strangers; and without one still.
ALIEN_SIZE = {"wide hysteresis": 15.0, "two wheels": 8.0, "warm neighbour": 1500.0}
JOINED = ("encoder_thermal", "gear_mesh", "self_heating", "stylus_sag", "artefact_sag")
#: What one joint can have at once, and the joints at which all of it shows.
AT_ONE_JOINT = (
    "encoder_eccentricity", "encoder_ellipticity", "encoder_periodic", "encoder_scale",
    "encoder_slip", "joint_backlash", "axis_wobble", "joint_thermal", "time_skew",
)  # fmt: skip
ONE_JOINT = (2, 3, 4)
#: What goes by a link's or a joint's own sensor, and where it shows.
BY_A_SENSOR = ("thermal_gradient", "joint_thermal", "encoder_thermal", "link_expansion")
OWN_SENSOR = (2, 4)
REAL = Path(__file__).parents[1] / "real" / "data"


@dataclass(frozen=True)
class Told:
    """One finding as it is told."""

    cause: str
    location: str
    probability: float
    depends_on: tuple[str, ...]
    share: float  # of what goes with its variables it explains


@dataclass(frozen=True)
class Strange:
    """What came of one case, small enough to pass between processes."""

    kind: str
    seed: int
    #: cause, location, what of it, and its noise units clear of all that absorbs and of the others
    truths: tuple[tuple[str, str, str, float], ...]
    variables: tuple[str, ...]  # of a stranger
    told: tuple[Told, ...]
    before_um: float  # held out
    after_um: float
    oracle_um: float
    seconds: float
    #: of each truth of several, its noise units clear of whatever the others can do as well
    apart: tuple[float, ...] = ()

    @property
    def places(self) -> list[tuple[str, str]]:
        return [(t.cause, t.location) for t in self.told]

    @property
    def due(self) -> list[tuple[str, str]]:
        """What was planted and is large enough to be named."""
        return [(cause, where) for cause, where, _, snr in self.truths if snr >= SEEN]

    @property
    def named(self) -> int:
        return sum(place in self.places for place in self.due)

    @property
    def due_apart(self) -> list[tuple[str, str]]:
        """What of that can be told from what the others may do."""
        return [
            truth[:2] for truth, snr in zip(self.truths, self.apart, strict=True) if snr >= SEEN
        ]

    def _fits(self, one: Told) -> bool:
        """Nameless, in a stranger's own variables."""
        return one.cause == "unknown" and set(one.depends_on) <= set(self.variables)

    @property
    def foreign(self) -> list[Told]:
        """Findings that are neither planted nor nameless."""
        planted = [truth[:2] for truth in self.truths]
        return [
            t for t in self.told if t.cause != "unknown" and (t.cause, t.location) not in planted
        ]

    @property
    def right(self) -> bool:
        if self.kind not in NAMELESS:
            return self.named == len(self.due) and not self.foreign
        named = self.truths[0][0] != "unknown" and self.truths[0][:2] in self.places
        named = named or any(map(self._fits, self.told))
        return named and not self.foreign

    @property
    def near(self) -> bool:
        """Nothing sure is wrong, and a finding shares a variable with the stranger."""
        shares = any(set(t.depends_on) & set(self.variables) for t in self.told)
        return not self.right and shares and not self.sure_and_wrong

    @property
    def sure_and_wrong(self) -> int:
        return sum(t.probability >= SURE for t in self.foreign)

    @property
    def worse(self) -> bool:
        return self.after_um > 1.02 * self.before_um


def run_strange(kind: str, seed: int) -> Strange:
    """One case of a kind, made, diagnosed and judged."""
    rng = np.random.default_rng([seed, 0x57A6])
    started = time.perf_counter()
    runs: dict[str, Callable[[int, np.random.Generator], Strange]] = {
        "stranger": _stranger,
        "alien": _alien,
        "crowd": _crowd,
        "again": _again,
        "real": _real,
        "offset": _offset,
        "exchanged": _exchanged,
        "late": _late,
        "ramped": _ramped,
        "bent": _bent,
    }
    return replace(runs[kind](seed, rng), seconds=time.perf_counter() - started)


def _told(diagnosis: Diagnosis) -> tuple[Told, ...]:
    return tuple(
        Told(
            f.candidate.cause,
            str(f.candidate.location) if f.candidate.cause != "unknown" else "-",
            f.probability,
            f.candidate.depends_on,
            f.explained.share if f.explained else 1.0,
        )
        for f in diagnosis.findings
    )


def draw_stranger(rng: np.random.Generator) -> Plant:
    """One that joined the catalogue, or one of the kinds that did not; mostly well visible."""
    kinds = [*JOINED, *FOREIGN_SIZE]
    kind = str(rng.choice(kinds))
    factor = float(np.exp(rng.uniform(0.2, 1.2)))
    if kind in JOINED:
        return draw_plant(rng, [kind], factor)
    joint, other = (int(j) for j in rng.choice([2, 3, 4], 2, replace=False))
    detail: dict[str, float | str] = {"kind": kind, "joint": joint, "other": other}
    return Plant("unknown", "-", factor * FOREIGN_SIZE[kind], detail)


def _stranger(seed: int, rng: np.random.Generator) -> Strange:
    return _simulated("stranger", seed, [draw_stranger(rng)])


def _alien(seed: int, rng: np.random.Generator) -> Strange:
    kind = list(ALIEN_SIZE)[seed % len(ALIEN_SIZE)]
    joint = int(rng.choice([2, 3, 4]))
    other = joint + int(rng.choice([-1, 1]))
    size = float(np.exp(rng.uniform(-0.3, 0.7))) * ALIEN_SIZE[kind]
    detail: dict[str, float | str] = {"kind": kind, "joint": joint, "other": other}
    return _simulated("alien", seed, [Plant("unknown", "-", size, detail)])


def _crowd(seed: int, rng: np.random.Generator) -> Strange:
    count = int(rng.integers(4, 6))
    if seed % 2:
        joint = int(rng.choice(ONE_JOINT))
        causes = rng.choice(AT_ONE_JOINT, count, replace=False)
        plants = [_at(joint, draw_plant(rng, [str(cause)], 1.5)) for cause in causes]
    else:
        known = [c for c in CAUSES if c not in ("unknown", "outliers", "artefact_sag")]
        causes = rng.choice(known, count, replace=False)
        plants = [draw_plant(rng, [str(cause)], 1.5) for cause in causes]
    return _simulated("crowd", seed, plants)


def _offset(seed: int, rng: np.random.Generator) -> Strange:
    number, cause = _by_its_sensor(rng)
    offset = replace(draw_plant(rng, ["sensor_offset"]), location=f"sensor t{number}")
    return _simulated("offset", seed, [cause, offset])


def _exchanged(seed: int, rng: np.random.Generator) -> Strange:
    number, cause = _by_its_sensor(rng)
    other = int(rng.choice([k for k in range(1, 7) if k != number]))
    a, b = sorted((number, other))
    return _simulated(
        "exchanged", seed, [cause, Plant("sensor_swapped", f"sensors t{a}, t{b}", 1.0)]
    )


def _late(seed: int, rng: np.random.Generator) -> Strange:
    number, cause = _by_its_sensor(rng)
    return _simulated("late", seed, [cause, _at(number, draw_plant(rng, ["thermal_lag"]))])


def _ramped(seed: int, rng: np.random.Generator) -> Strange:
    number = int(rng.choice(OWN_SENSOR))
    drawn = draw_plant(rng, ["link_expansion"], 3.0), draw_plant(rng, ["thermal_lag"], 1.5)
    return _simulated("ramped", seed, [_at(number, plant) for plant in drawn], RAMPED)


def _bent(seed: int, rng: np.random.Generator) -> Strange:
    number = int(rng.choice(OWN_SENSOR))
    drawn = draw_plant(rng, ["thermal_gradient"]), draw_plant(rng, ["thermal_lag"], 1.5)
    return _simulated("bent", seed, [_at(number, plant) for plant in drawn], RAMPED)


def _by_its_sensor(rng: np.random.Generator) -> tuple[int, Plant]:
    """The number of a link or joint, and what goes by its sensor there."""
    number = int(rng.choice(OWN_SENSOR))
    return number, _at(number, draw_plant(rng, [str(rng.choice(BY_A_SENSOR))], 1.5))


def _at(number: int, plant: Plant) -> Plant:
    return replace(plant, location=f"{plant.location.split()[0]} {number}")


def _simulated(kind: str, seed: int, plants: Sequence[Plant], design: Design = DESIGN) -> Strange:
    held = any(plant.cause in HELD for plant in plants)
    design = replace(design, before=4) if held else design
    made = make_case(seed, plants, design)
    diagnosis = diagnose(made.sessions, made.arm, made.calibrate_before())
    errors = made.errors_mm()
    first, noise = diagnosis.search.first, diagnosis.search.last.noise
    snr = [
        projected_snr(first, error, noise, [e for e in errors if e is not error])
        for error in errors
    ]
    return Strange(
        kind,
        seed,
        tuple(
            (p.cause, p.location, _words(p), value) for p, value in zip(plants, snr, strict=True)
        ),
        tuple(list_columns(plants[0])) if kind in NAMELESS else (),
        _told(diagnosis),
        rms_um(made.holdout, made.arm, diagnosis.baseline.calibration),
        rms_um(made.holdout, made.arm, diagnosis.extended),
        made.case.oracle_rms_um(made.case.holdout),
        0.0,
        _apart(diagnosis, errors, plants),
    )


def _apart(
    diagnosis: Diagnosis, errors: Sequence[np.ndarray], plants: Sequence[Plant]
) -> tuple[float, ...]:
    """What each of several effects has clear of what the others can do; of one, nothing."""
    if len(plants) == 1:
        return ()
    return told_apart(diagnosis, errors, [(p.cause, p.location) for p in plants])


def _words(plant: Plant) -> str:
    kind = plant.detail.get("kind", "") if plant.cause == "unknown" else ""
    return f"{kind} {plant.size:.3g}".strip()


def _draw_planted(
    rng: np.random.Generator, sessions: Sequence[Session], joints: Sequence[int], arcsec: float
) -> tuple[str, str, Effect]:
    """What goes into the angles of sessions that are there already; rates where they are known."""
    joint, phase = int(rng.choice(joints)), float(rng.uniform(0, 2 * np.pi))
    size = arcsec * float(np.exp(rng.normal(0.0, 0.3)))
    kinds = ["encoder_eccentricity", "encoder_ellipticity", "encoder_periodic"]
    if np.isfinite(sessions[0].states.time_s).all():
        kinds.append("encoder_slip")
    if np.isfinite(sessions[0].states.rate).any():
        kinds.append("joint_backlash")
    cause = str(rng.choice(kinds))
    where = f"joint {joint}"
    match cause:
        case "encoder_slip":
            return cause, where, slip(joint, size, middle_unix_s(sessions))
        case "joint_backlash":
            side = of_joint(joint, lambda s: 0.5 * size * np.sign(s.rate[:, joint - 1]))
            return cause, where, side
        case "encoder_periodic":
            return cause, where, wave(joint, size, int(rng.integers(3, 9)), phase)
    return cause, where, wave(joint, size, 1 if cause == "encoder_eccentricity" else 2, phase)


def _again(seed: int, rng: np.random.Generator) -> Strange:
    """Healthy sessions, one effect more at each of three times; judged is the third."""
    made = make_case(seed, (), Design(sessions=10, articulations=3, before=5, holdout=2))
    times = [made.before, made.sessions[:5], made.sessions[5:]]
    effects: list[tuple[str, str, Effect]] = []
    calibration: Calibration | None = None
    for sessions in times:
        while True:
            more = _draw_planted(rng, sessions, (2, 3, 4, 5), 9.0)
            if more[:2] not in [effect[:2] for effect in effects]:
                break
        effects.append(more)
        under = calibration
        found = diagnose(planted(sessions, *(e for *_, e in effects)), made.arm, under)
        calibration = found.extended
    return _judged("again", seed, found, effects, made.holdout, times[2])


def _judged(
    kind: str,
    seed: int,
    found: Diagnosis,
    effects: Sequence[tuple[str, str, Effect]],
    holdout: Sequence[Session],
    measured: Sequence[Session],
    known: Sequence[tuple[str, str]] = (),
) -> Strange:
    """The last effect is what is new; *known*: what is told without it too."""
    cause, where, new = effects[-1]
    every = [effect for *_, effect in effects]
    arm, given = found.arm, found.baseline.calibration
    error = np.concatenate([_moves(session, new, given) for session in measured])
    snr = projected_snr(found.search.first, error, found.search.last.noise)
    return Strange(
        kind,
        seed,
        ((cause, where, "", snr),),
        (),
        tuple(t for t in _told(found) if (t.cause, t.location) not in {*known} - {(cause, where)}),
        rms_um(planted(holdout, *every), arm, given),
        rms_um(planted(holdout, *every), arm, found.extended),
        rms_um(planted(holdout, *every[:-1]), arm, given),
        0.0,
    )


def _moves(session: Session, effect: Effect, calibration: Calibration) -> np.ndarray:
    """How far an effect moves what the model says of the tip, (n, 3) mm."""
    q, constants = session.states.q, calibration.vector(session.states.q.shape[1])
    tip = [compute_pose(angles, constants)[0] for angles in (q + effect(session.states), q)]
    moved: np.ndarray = tip[0] - tip[1]
    return moved


@dataclass(frozen=True)
class RealArm:
    """A real arm diagnosed once; what was measured since, and what is told of that as it is."""

    arm: Arm
    extended: Calibration
    since: list[Session]
    holdout: list[Session]
    joints: tuple[int, ...]
    arcsec: float
    known: tuple[tuple[str, str], ...]


@functools.cache
def real_arm(name: str) -> RealArm:
    """ "ur10" (series B) or "kinova" (seats)."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        if name == "ur10":
            ur10(REAL / "ur10_laser_tracker", folder)
            arm = load_arm(folder / "arm.toml")
            first = load_session(folder / "B-train", arm)
            since = load_session(folder / "B-heldout", arm)
            joints, arcsec = (1, 2, 3, 4), 40.0
        else:
            ball_in_socket(REAL / "ball_in_socket", "dinova_1", folder)
            arm = load_arm(folder / "arm.toml")
            whole = load_session(folder / "seats", arm)
            rows = np.random.default_rng(3).permutation(whole.n) < whole.n // 2
            first, since = whole.rows(rows), whole.rows(~rows)
            joints, arcsec = (2, 3, 4), 3600.0
        extended = diagnose([first], arm).extended
        shown = np.random.default_rng(5).permutation(since.n) < since.n * 2 // 3
        measured, holdout = since.rows(shown), since.rows(~shown)
        as_it_is = diagnose([measured], arm, extended)
        known = tuple(f.candidate.place for f in as_it_is.findings)
        return RealArm(arm, extended, [measured], [holdout], joints, arcsec, known)


def _real(seed: int, rng: np.random.Generator) -> Strange:
    real = real_arm("kinova" if seed % 4 == 3 else "ur10")
    effect = _draw_planted(rng, real.since, real.joints, real.arcsec)
    found = diagnose(planted(real.since, effect[2]), real.arm, real.extended)
    return _judged("real", seed, found, [effect], real.holdout, real.since, real.known)


def tell(o: Strange) -> str:
    truths = " + ".join(
        f"{cause} {where} {what} [{snr:.0f}{clear}]"
        for (cause, where, what, snr), clear in zip(o.truths, _clear(o), strict=True)
    )
    told = "; ".join(
        f"{t.cause} {t.location if t.cause != 'unknown' else ', '.join(t.depends_on)} "
        f"{t.probability:.2f}"
        for t in o.told
    )
    marks = ("SURE AND WRONG " if o.sure_and_wrong else "") + ("WORSE " if o.worse else "")
    good = "ok " if o.right else "~~ " if o.kind in NAMELESS and o.near else "-- "
    return (
        f"{good}{marks}{o.kind} {o.seed}: {truths} → {told or 'silence'}; {o.before_um:.2f} → "
        f"{o.after_um:.2f} (oracle {o.oracle_um:.2f}) µm, {o.seconds:.0f} s"
    )


def _clear(o: Strange) -> list[str]:
    """What each truth has clear of what the others can do, as it is told."""
    return [f", apart {snr:.0f}" for snr in o.apart] or [""] * len(o.truths)


def _of_several(kind: str, own: Sequence[Strange]) -> list[tuple[str, str, str]]:
    """Of effects planted together: those that can be told apart; where all are at one joint, and
    where not."""
    several = [o for o in own if o.apart]
    found = []
    apart = [place in o.places for o in several for place in o.due_apart]
    if several:
        name = f"{kind}: named, of those that can be told apart"
        found.append((name, f"{sum(apart)} of {len(apart)}", "0.95"))
    for name, at_one_joint in (("all over the arm", False), ("at one joint", True)):
        some = [o for o in several if kind == "crowd" and bool(o.seed % 2) == at_one_joint]
        if some:
            named, due = sum(o.named for o in some), sum(len(o.due) for o in some)
            found.append((f"{kind}, {name}: effects named", f"{named} of {due}", ""))
    return found


def rows(outcomes: Sequence[Strange]) -> list[tuple[str, str, str]]:
    """What was reached, and the mark, of each kind that ran."""
    found = []

    def share(name: str, count: float, of: int, mark: str) -> None:
        found.append((name, f"{count:g} of {of}", mark))

    for kind in KINDS:
        own = [o for o in outcomes if o.kind == kind]
        if not own:
            continue
        if kind in NAMELESS:
            seen = [o for o in own if o.due]
            share(f"{kind}s: right", sum(o.right for o in seen), len(seen), "")
            both = sum(o.right or o.near for o in seen)
            share(f"{kind}s: right or near", both, len(seen), "0.90")
        else:
            due = sum(len(o.due) for o in own)
            share(f"{kind}: effects named", sum(o.named for o in own), due, "0.95")
            found += _of_several(kind, own)
            extra = sum(len(o.foreign) for o in own)
            share(f"{kind}: extra findings, in sets", extra, len(own), "at most 0.1")
        sure = sum(bool(o.sure_and_wrong) for o in own)
        found.append((f"{kind}: sure and wrong", at_most(sure, len(own)), "at most 0.02"))
        share(f"{kind}: extended worse by 2 %", sum(o.worse for o in own), len(own), "0.01")
        possible = sum(o.before_um**2 - o.oracle_um**2 for o in own)
        reached = sum(o.before_um**2 - o.after_um**2 for o in own)
        found.append((f"{kind}: gain, of the oracle's", f"{reached / possible:.2f}", "0.90"))
    return found
