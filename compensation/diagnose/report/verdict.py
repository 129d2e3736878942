"""The verdict of a diagnosis, in a sentence or two for a person."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial

import numpy as np

from armd.compensation.diagnose.constants import (
    BEYOND_NOISE,
    FAR_TIMES,
    LEAST_SPARE,
    MOST_FINDINGS,
    MOST_TOLD,
    UM_DIGITS,
    WOULD_SHOW,
)
from armd.compensation.diagnose.diagnosis import Diagnosis, MovedArtefact
from armd.compensation.diagnose.fitting.free_expansion import explain_missing_growth
from armd.compensation.diagnose.fitting.target_steps import (
    measure_target_steps,
    select_significant_steps,
)
from armd.compensation.diagnose.problem.layout import EXPANSIONS
from armd.compensation.diagnose.problem.rests import count_spare_rows
from armd.compensation.diagnose.report.sets import select_as_probable
from armd.compensation.diagnose.report.sizes import is_size_known
from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.effects.effect import Candidate
from armd.compensation.wording import format_clock, format_plain
from armd.terminal.counted import format_count


def write_verdict(diagnosis: Diagnosis) -> str:
    """Write the verdict of a diagnosis, in a sentence or two."""
    sentences = []
    refused, moved = _refused(diagnosis), _moved(diagnosis)
    gains = diagnosis.gains
    contradicted_later = diagnosis.contradicted_later
    numbered = partial(_numbers, diagnosis)
    report_only = [
        i for i, finding in enumerate(diagnosis.findings) if finding.candidate.is_report_only
    ]
    unwritten = {*contradicted_later, *report_only}
    doubtful = numbered(i for i, g in enumerate(gains) if not g.is_confirmed and i not in unwritten)
    if not gains:
        sentences.append(
            "No cause was found in the arm." if diagnosis.touched else "No cause was found."
        )
    else:
        count = format_count(_listed(diagnosis), "finding")
        if diagnosis.written:
            before, after = diagnosis.written_clear_um or diagnosis.written_rms_um
            how = f", {diagnosis.written_by}" if diagnosis.written_by else ""
            if diagnosis.written_clear_um:
                all_rows = " instead of ".join(
                    format_um(rms) for rms in diagnosis.written_rms_um[::-1]
                )
                how += f", outliers left out of both; {all_rows} µm with them"
            missing = len(diagnosis.written) < len(gains)
            which = f", {numbered(diagnosis.written)} in it," if missing else ""
            sentences.append(
                f"{count}; with the extended model{which} held-out readings err by "
                f"{format_um(after)} µm instead of {format_um(before)} µm (3-D RMS{how})."
            )
            sentences += _describe_later_gain(diagnosis)
            sentences += _of_growth(diagnosis)
        if doubtful:
            sentences.append(f"Held-out readings do not confirm {doubtful}: leads, not facts.")
        if contradicted_later:
            sentences.append(
                f"What goes with time, {numbered(contradicted_later)}, is not in it: fitted to the "
                "earlier readings, it makes the later ones worse. Measure longer."
            )
        sentences += _describe_rival_sets(diagnosis)
        if report_only:
            numbers = numbered(report_only)
            sentences.append(f"No calibration can contain {numbers}: reported, and not written.")
        guesses = numbered(
            i
            for i, finding in enumerate(diagnosis.findings)
            if finding.candidate.cause != "unknown"
            and finding.explained
            and finding.explained.guess
        )
        if guesses:
            sentences.append(
                f"The name of {guesses} is a guess: it explains little of what varies with its "
                "variables."
            )
        unsized = numbered(i for i in range(len(gains)) if not is_size_known(diagnosis, i))
        if unsized:
            sentences.append(f"The size of {unsized} is within its own uncertainty.")
        if not diagnosis.written:
            sentences.append(
                f"{count}, none of them {'confirmed' if doubtful else 'written'}: the extended "
                "calibration predicts what the model under test does, "
                f"{format_um(diagnosis.heldout_rms_um)} µm held out."
            )
    if diagnosis.significant_rest:
        on = ", ".join(diagnosis.search.remaining_depends_on) or "nothing that was recorded"
        sentences.append(f"Something significant is left; it depends on {on}.")
        same = [
            i
            for i, finding in enumerate(diagnosis.findings)
            if set(finding.candidate.depends_on) & set(diagnosis.search.remaining_depends_on)
        ]
        if same:
            sentences.append(f"The form of {numbered(same)} is in doubt.")
        if len(gains) == MOST_FINDINGS:
            sentences.append(
                f"No more than {MOST_FINDINGS} causes are looked for; where so much seems wrong, "
                "see first whether arm.toml, calibration and artefact are those of these readings."
            )
    elif not gains and not diagnosis.outliers:
        sentences.append(_nothing_found(diagnosis, refused or moved))
    elif gains and not diagnosis.outliers:
        sentences.append(_what_stays(diagnosis))
    return " ".join(
        text
        for text in [
            *sentences,
            *refused,
            *moved,
            *map(describe_moved, diagnosis.touched),
            *diagnosis.remarks,
        ]
        if text
    )


def _describe_later_gain(diagnosis: Diagnosis) -> list[str]:
    """Describe the gain of the extended model in a session that nobody has measured yet."""
    if diagnosis.later_gain_um is None:
        return []
    low, high = map(format_um, diagnosis.later_gain_um)
    return [f"In another session like these it gains {low} to {high} µm (95 %)."]


def _describe_rival_sets(diagnosis: Diagnosis) -> list[str]:
    """Describe the sets of causes that may be there instead of findings, the likeliest first."""
    rivals = select_as_probable(diagnosis.search.rival_causes)
    return [
        f"Instead of {_numbers(diagnosis, rival.finding_numbers)} it may be "
        f"{' together with '.join(map(_named, rival.instead))} "
        f"({rival.odds:.2g} times as probable)."
        for rival in rivals[:MOST_TOLD]
    ]


def _of_growth(diagnosis: Diagnosis) -> list[str]:
    """Describe the written expansion that the calibration could not know and the readings show."""
    count = len(diagnosis.search.last.findings) - len(diagnosis.search.searched.findings)
    grown = [i for i in diagnosis.written if i < count]
    if not grown:
        return []
    if len(grown) == len(diagnosis.written):
        before, after = diagnosis.written_clear_um or diagnosis.written_rms_um
    else:
        before, after = diagnosis.gains[grown[0]].before_um, diagnosis.gains[grown[-1]].after_um
    which = f"{'finding' if len(grown) == 1 else 'findings'} {_numbers(diagnosis, grown)}"
    return [
        f"{explain_missing_growth(diagnosis.baseline)} With the growth of {which}, "
        f"held-out readings err by {format_um(after)} µm instead of {format_um(before)} µm."
    ]


def _numbers(diagnosis: Diagnosis, indices: Iterable[int]) -> str:
    """Number findings as they are listed for a person, from 1: moved artefacts come first."""
    return ", ".join(str(len(diagnosis.touched) + i + 1) for i in indices)


def _listed(diagnosis: Diagnosis) -> int:
    """Return how many findings are listed: moved artefacts count, and all outliers count as one."""
    return len(diagnosis.touched) + len(diagnosis.gains) + bool(diagnosis.outliers)


def _what_stays(diagnosis: Diagnosis) -> str:
    """Describe residuals beyond the noise in which nothing is significant, next to findings."""
    rms, floor = diagnosis.remaining_rms_um, diagnosis.noise_floor_um
    if rms <= BEYOND_NOISE * floor:
        return ""
    return (
        f"Yet {format_um(rms)} µm remain under the extended calibration; "
        "the noise alone would leave "
        f"{format_um(floor)} µm."
    )


def _nothing_found(diagnosis: Diagnosis, but: Sequence[str]) -> str:
    """Describe the residuals when nothing was found; *but*: what else the verdict reports."""
    rms, floor = diagnosis.rms_um, diagnosis.noise_floor_um
    absorbing = _absorbing(diagnosis)
    remain = 1e3 * float(np.sqrt((diagnosis.search.last.point_residual_mm**2).sum(axis=1).mean()))
    if absorbing and rms > BEYOND_NOISE * floor >= remain:
        return (
            f"The residuals, {format_um(rms)} µm, are more than noise of {format_um(floor)} µm "
            "makes: they are "
            f"explained by {absorbing}; {format_um(remain)} µm remain beside that."
        )
    if rms > BEYOND_NOISE * floor:
        partly = bool(absorbing) and rms > BEYOND_NOISE * remain
        explained = f"a part is explained by {absorbing}; " if partly else ""
        unexplained = f"the {format_um(remain)} µm that remain" if partly else "them"
        return (
            f"Yet the residuals, {format_um(rms)} µm, are not what noise of {format_um(floor)} µm "
            "makes: "
            f"{explained}nothing in the catalogue, nor any smooth structure, explains "
            f"{unexplained}.{_describe_far_readings(diagnosis)}"
        )
    if but:
        return ""
    return f"The residuals are what the noise makes of them. {_could_show(diagnosis)}"


def _absorbing(diagnosis: Diagnosis) -> str:
    """Name what may absorb residuals and is no finding."""
    last = diagnosis.search.last
    if last.baseline.growth:
        return "the calibration's uncertainty and growth of links that it could not know"
    if last.baseline.is_given:
        return "the calibration's uncertainty"
    expansions = last.layout.blocks[EXPANSIONS]
    return "the links' plain expansion" if expansions.stop > expansions.start else ""


def _describe_far_readings(diagnosis: Diagnosis) -> str:
    """Describe the few readings that make the residuals: too many to be single mistakes."""
    last = diagnosis.search.last
    off_mm = np.linalg.norm(last.point_residual_mm, axis=1)
    usual_mm = float(np.median(off_mm))
    n_far = int((off_mm > FAR_TIMES * usual_mm).sum())
    if not n_far:
        return ""
    observations = last.linear.rests.observations
    farthest = ", ".join(
        f"{observations.name_row(i)} ({off_mm[i]:.3g} mm)"
        for i in np.argsort(-off_mm)[: min(n_far, MOST_TOLD)]
    )
    return (
        f" Half of all readings lie within {format_um(1e3 * usual_mm)} µm, "
        f"{n_far} more than {FAR_TIMES:g}"
        f" times as far off, most of all {farthest}: look at these first."
    )


def _could_show(diagnosis: Diagnosis) -> str:
    """Describe whether causes of ordinary size would have been found."""
    rests = diagnosis.search.last.linear.rests
    spare = count_spare_rows(rests.observations)
    if spare < LEAST_SPARE:
        return (
            f"But {format_count(rests.points.n, 'reading')} at rest leave only "
            f"{format_count(spare, 'number')} beyond what their placements take up: hardly any "
            "cause could have shown."
        )
    hidden = sorted(c for c, snr in diagnosis.search.would_show.items() if snr < WOULD_SHOW)
    if not hidden:
        which = "Any cause that these data can tell" if diagnosis.search.untold else "Any cause"
        return f"{which} would have shown, were it of its typical size."
    return f"Of its typical size, these readings would not have shown: {', '.join(hidden)}."


def _refused(diagnosis: Diagnosis) -> list[str]:
    return [
        f"{_named(refusal.candidate)} was refused, although the residuals would fall: "
        f"{refusal.reason}."
        for refusal in diagnosis.search.refused
    ]


def _moved(diagnosis: Diagnosis) -> list[str]:
    return [
        f"At {step.placement}, {step.target}, the first {step.after} rests stand "
        f"{format_um(step.step_um)} µm from the other {step.rests - step.after}: "
        "seat, artefact or arm moved between."
        for step in select_significant_steps(measure_target_steps(diagnosis.search.last))
    ]


def _named(candidate: Candidate) -> str:
    """Return a candidate in words."""
    if candidate.cause == "unknown":
        return f"A structure in {', '.join(candidate.depends_on)} ({candidate.location})"
    return f"{candidate.cause} ({candidate.location})"


def format_um(value: float) -> str:
    """Format micrometres for a person: three digits, no exponent."""
    return format_plain(value, UM_DIGITS)


def describe_moved(touched: MovedArtefact) -> str:
    """Describe which artefact was moved, where and when."""
    move = CATALOGUE["artefact_moved"].describe(touched.candidate, touched.amplitudes)
    instant = (
        "" if np.isnan(touched.instant_unix_s) else f", {format_clock(touched.instant_unix_s)}"
    )
    return (
        f"In {touched.session}, {touched.placement}, before row {touched.row}{instant}, {move}: "
        "its readings count as two placements; the arm did not cause it."
    )
