"""Decide whether an identification gets a certificate, judged by held-out readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armd.compensation.estimate.gauge import PLAUSIBLE, is_scale_free
from armd.compensation.estimate.linear.solution import LEAST_KNOWN
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.unknowns import is_indicator
from armd.compensation.identify.admission.reading_counts import CERTIFICATE_TIMES, LEAST_PLACEMENTS
from armd.compensation.identify.admission.requirements import count_least_readings_for_observations
from armd.compensation.identify.admission.second_group import Differs, SecondGroup
from armd.compensation.identify.drawing import OffNominal
from armd.compensation.identify.evaluation.lengths import MOST_OFF, Length
from armd.compensation.identify.fit import Identification
from armd.compensation.identify.heldout import (
    Errors,
    compute_another_placement_um,
    describe_held_out,
)
from armd.compensation.identify.next_step import CalibratedFiles, Objection, Why, choose_next_step
from armd.terminal.counted import format_count

#: The kind of a granted certificate, and what it is not.
KIND = "identification record, not an ISO 17025 certificate"
#: A smaller arm scatters less, so no scatter reveals a wrong size.
NO_SCALE = (
    "no certified length determines the arm's size well enough: lengths are only as good as the"
    " drawing, and all of them may be wrong by the same share"
)
#: Held-out readings must lose at least half of the error that they have under the nominal geometry,
MOST_LEFT = 0.5
#: or miss by hardly more than the noise of one reading: no calibration lowers that, and a right
#: nominal geometry misses by no more. With barely enough readings of a right one, 59 of 60 draws
#: stay below.
MOST_NOISE = 1.25
#: A larger held-out miss is as uncertain as a direction that counts as not known.
MOST_HELDOUT_MM = PLAUSIBLE["mm"] / LEAST_KNOWN
#: The least rank, as a share of that of ideal readings, to vouch for other postures.
LEAST_RANK = 0.75
#: No room in which people measure is colder or warmer.
POSSIBLE_C = (-10.0, 60.0)
#: Nor do one arm's readings, or one reading's sensors, differ by more: 20 °C and 68 °F do.
MOST_APART_K = 30.0
#: The rule, as a report states it.
RULE = (
    f"granted if the fit settled; readings left out miss by {100 * MOST_LEFT:g} % at most of what"
    " they miss by with the dimensions of the drawing and the tip that suits these readings, or"
    f" {MOST_NOISE:g} times the noise of one reading, and by"
    f" {MOST_HELDOUT_MM:g} mm RMS at most; {100 * LEAST_RANK:g} % of what ideal readings would"
    f" determine is known; there are {LEAST_PLACEMENTS} placements and {CERTIFICATE_TIMES} times"
    f" the readings needed; the temperatures are possible ({POSSIBLE_C[0]:g} to"
    f" {POSSIBLE_C[1]:g} °C, {MOST_APART_K:g} K apart at most); and no"
    f" certified length is off by more than {MOST_OFF:g} standard uncertainties. For lengths"
    " only if certified lengths or positions determine the size of the arm"
)


@dataclass(frozen=True)
class Certificate:
    """A verdict and its reason, in words."""

    granted: bool
    reason: str
    kind: str = KIND
    scale_known: bool = True  # a certified length or position determines the arm's size
    next_step: str = ""  # of a refused certificate: what to do, with the command to type

    @property
    def word(self) -> str:
        """The verdict in a few words; "granted" always states if no length was measured."""
        if not self.granted:
            return "refused"
        return "granted" if self.scale_known else "granted, but not for lengths"

    def in_words(self) -> str:
        return f"{self.kind}: {self.word}: {self.why_and_next()}"

    def why_and_next(self) -> str:
        """Return the reason, and for a refused certificate what to do next."""
        return f"{self.reason}. Next: {self.next_step}" if self.next_step else self.reason


@dataclass(frozen=True)
class Misses:
    """The 3-D RMS misses of the readings under several models."""

    nominal_rms_um: float
    """Under the drawing."""
    noise_rms_um: float
    """Of one reading, whatever the model."""
    heldout: Errors
    """Under fits that left the readings out."""
    heldout_by: str


@dataclass(frozen=True)
class Suspects:
    """Possible faults of the readings or of the nominal geometry."""

    inconsistent_session: Path | None = None
    """The folder of one that does not fit the others."""
    second: SecondGroup | None = None
    """Rows of another tip or place, which then are why readings miss; nothing else is guessed."""
    off_drawing: Sequence[OffNominal] = ()
    """Parameters far off the drawing: no fault of the calibration, and somebody should know."""


def judge(
    identification: Identification,
    converged: bool,
    misses: Misses,
    lengths: Sequence[Length],
    suspects: Suspects | None = None,
    files: CalibratedFiles | None = None,
) -> Certificate:
    """Judge a calibration by the misses of held-out readings.

    *identification* holds all constants, and with a thermal model the linear expansion of the
    lengths. *files* are those that the next step names.
    """
    suspects = suspects or Suspects()
    nominal_rms_um, noise_rms_um = misses.nominal_rms_um, misses.noise_rms_um
    heldout = misses.heldout
    drawn_mm, heldout_mm = nominal_rms_um / 1e3, heldout.rms_um / 1e3
    share = heldout.rms_um / nominal_rms_um if nominal_rms_um else 1.0
    percent = f"{100 * share:.0f}" if share > 0.1 else f"{100 * share:.2g}"  # never 1.1e+02
    most_mm = max(MOST_LEFT * drawn_mm, MOST_NOISE * noise_rms_um / 1e3)
    set_words = describe_held_out(identification.observations, heldout, misses.heldout_by)
    summary = (
        f"{set_words} left out misses by"
        f" {heldout_mm:.4g} mm RMS,"
        f" {percent}% of the {drawn_mm:.4g} mm that the drawing's own dimensions miss by"
    )
    if share > MOST_LEFT:
        times = heldout.rms_um / noise_rms_um
        summary += f" and {times:.2f} times a reading's noise of {noise_rms_um / 1e3:.4g} mm"
    faults = []
    if not converged:
        faults.append(Objection(Why.UNSETTLED, "the fit did not settle"))
    if folder := suspects.inconsistent_session:
        words = f"session {folder.name} does not fit the others, and no one arm fits all"
        faults.append(Objection(Why.ODD_SESSION, words, str(folder)))
    if suspects.second:
        faults.append(_object_to_second_group(suspects.second))
    if heldout_mm > most_mm:
        words = (
            f"more than the {MOST_LEFT:.0%} that shows a calibration to help, and than"
            f" {MOST_NOISE:g} times the noise"
        )
        faults.append(Objection(Why.NO_HELP, words))
    without_mm = heldout.without_down_weighted_um / 1e3
    most_mm = min(MOST_HELDOUT_MM, most_mm)
    single = len(identification.outliers) and not suspects.second
    if heldout_mm > most_mm > without_mm and single:
        n_without = format_count(heldout.n_down_weighted, "down-weighted reading")
        words = f"{without_mm:.4g} mm without {n_without}: {identification.outlier_words()}"
        faults.append(Objection(Why.OUTLIERS, words))
    elif heldout_mm > MOST_HELDOUT_MM:
        words = f"more than {MOST_HELDOUT_MM:g} mm"
        if not suspects.second:
            words += (
                ": no set of constants describes this arm (another arm than arm.toml draws, play"
                " in a joint, a loose artefact, readings mixed up?)"
            )
        faults.append(Objection(Why.FAR, words))
    summary += _describe_another_placement(identification.observations, heldout, misses.heldout_by)
    ideal = 4 * identification.observations.arm.n_joints - 3 + len(identification.unknowns.terms)
    rank = identification.solution.rank
    if rank < LEAST_RANK * ideal:
        words = f"only {rank} of {ideal} combinations of the unknowns are known beside it"
        faults.append(Objection(Why.POSTURES, words))
    faults += _object_to_too_few(identification.observations)
    faults += _object_to_temperatures(identification.observations)
    faults += [
        Objection(
            Why.LENGTH,
            f"a certified length contradicts the arm: {length.in_words()}",
            targets=tuple(name.rpartition("/")[2] for name in length.between),
        )
        for length in lengths
        if abs(length.off) > MOST_OFF
    ]
    scale_known = not is_scale_free(
        identification.solution.null,
        identification.unknowns.words(identification.terms),
        identification.observations.arm,
    )
    scale = [] if scale_known else [NO_SCALE]
    remarks = []
    if share > MOST_LEFT and heldout_mm <= most_mm:
        remarks.append(
            "what is left is noise, or what no constants describe (`armd diagnose` looks for it)"
        )
    if suspects.off_drawing:
        remarks.append(
            f"arm.toml is far off: {', '.join(entry.in_brief() for entry in suspects.off_drawing)}"
        )
    files = files or CalibratedFiles(tuple(map(Path, identification.observations.session_names)))
    return Certificate(
        not faults,
        "; ".join([summary, *(fault.words for fault in faults), *remarks, *scale]),
        scale_known=scale_known,
        next_step=choose_next_step(
            faults,
            identification.observations,
            files,
            [entry.parameter for entry in suspects.off_drawing],
        ),
    )


def _describe_another_placement(
    observations: Observations, heldout: Errors, heldout_by: str
) -> str:
    """Describe the limit that another placement stays below, if few were measured.

    It takes the place of the mean over these few placements, for places where nothing was measured.
    """
    another_um = compute_another_placement_um(observations, heldout, heldout_by)
    if another_um is None:
        return ""
    low, high = min(heldout.of_sets_um) / 1e3, max(heldout.of_sets_um) / 1e3
    return (
        f" (by placement {low:.4g} to {high:.4g} mm: another placement may miss by up to"
        f" {another_um / 1e3:.4g} mm RMS, with 95% probability)"
    )


def _object_to_second_group(second: SecondGroup) -> Objection:
    rows = " and ".join(session.in_words() for session in second.sessions if not session.is_whole)
    why = Why.OTHER_TIP if second.differs is Differs.TIP else Why.OTHER_PLACE
    return Objection(why, second.in_words(), rows=rows, folders=second.folders)


def _object_to_too_few(observations: Observations) -> list[Objection]:
    """List objections to too few placements or readings.

    A tracker sees the arm everywhere, so it needs no second placement.
    """
    faults = []
    placements = len(np.unique(observations.placement))
    if placements < LEAST_PLACEMENTS and not observations.has_truth.all():
        words = (
            f"{format_count(placements, 'placement')}, expected at least {LEAST_PLACEMENTS}:"
            " another place may miss by any amount"
        )
        faults.append(Objection(Why.PLACEMENTS, words))
    needed = CERTIFICATE_TIMES * count_least_readings_for_observations(observations)
    postures = observations.n_postures
    if postures < needed:
        copies = f" of {format_count(postures, 'posture')}" if postures < observations.n else ""
        words = (
            f"{format_count(observations.n, 'reading')}{copies}, expected at least {needed}: "
            f"{CERTIFICATE_TIMES} times what the unknowns take"
        )
        faults.append(Objection(Why.READINGS, words))
    return faults


def _object_to_temperatures(observations: Observations) -> list[Objection]:
    """List sensors with impossible values or ranges: another unit, another arm."""
    columns = [i for i, name in enumerate(observations.arm.sensors) if not is_indicator(name)]
    celsius = observations.states.temperature_c[:, columns]
    sensors = [observations.arm.sensors[i] for i in columns]
    if not np.isfinite(celsius).any():
        return []
    faults = []
    for name, column in zip(sensors, celsius.T, strict=True):
        if not np.isfinite(column).any():
            continue
        low, high = float(np.nanmin(column)), float(np.nanmax(column))
        if high - low > MOST_APART_K or low < POSSIBLE_C[0] or high > POSSIBLE_C[1]:
            warmest = observations.session_names[observations.session[int(np.nanargmax(column))]]
            words = (
                f"{name} reads {low:.1f} to {high:.1f} °C (session {warmest}), expected at most"
                f" {MOST_APART_K:g} K apart within {POSSIBLE_C[0]:g} to {POSSIBLE_C[1]:g} °C"
                " (degrees Fahrenheit?)"
            )
            faults.append(Objection(Why.TEMPERATURES, words, warmest))
    rows = np.flatnonzero(np.isfinite(celsius).any(axis=1))
    apart_k = np.nanmax(celsius[rows], axis=1) - np.nanmin(celsius[rows], axis=1)
    farthest, widest_k = rows[int(np.argmax(apart_k))], float(np.max(apart_k))
    if not faults and widest_k > MOST_APART_K:
        words = (
            f"sensors of one reading {widest_k:.1f} K apart, expected at most {MOST_APART_K:g} K"
        )
        session = observations.session_names[observations.session[farthest]]
        faults.append(Objection(Why.TEMPERATURES, words, session))
    return faults
