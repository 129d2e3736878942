"""The diagnosis as one self-contained HTML file that opens offline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from armd.compensation.diagnose.constants import CURVES
from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.diagnose.predictive.curves import ResidualComparison
from armd.compensation.report.coverage import add_coverage
from armd.compensation.report.diagnosis.finding import add_finding
from armd.compensation.report.diagnosis.gains import draw_gains, name_finding
from armd.compensation.report.diagnosis.predictive_plot import (
    choose_for_finding,
    choose_overview,
    draw_rows,
)
from armd.compensation.report.layout.about import About
from armd.compensation.report.layout.drawing import make_single_figure
from armd.compensation.report.layout.head import add_head
from armd.compensation.report.layout.page import Page
from armd.compensation.report.layout.units import Unit, Units, choose_units
from armd.compensation.report.sessions import InputFile, add_origin
from armd.terminal.counted import format_count

#: Findings that are no named cause in the arm or its setup.
NO_CAUSES = ("artefact_moved", "outliers", "unknown")
#: The most findings in the table before the appendix.
MOST_FINDINGS = 6
#: The number of rows of curves that fill one page together with the coverage.
MOST_ROWS = 3
OVERVIEW_ROW_IN = 1.75
GAINS = "3-D RMS on held-out readings, as one finding after another is added"
#: The full text is in docs/developer/diagnosis-how.md.
RULE = (
    "Decision rule: a cause is reported where noise alone would reach its score, anywhere among the"
    " candidates, once in a hundred data sets at most. It is confirmed where it improves the"
    " prediction of readings that had no part in finding it: the 95 % interval of the gain is above"
    " zero."
)


def make_diagnosis_report(
    diagnosis: Diagnosis,
    result: dict[str, Any],
    files: Mapping[str, InputFile | None],
    comparisons: Sequence[ResidualComparison],
    about: About | None = None,
) -> str:
    """Make the page as HTML text.

    *result* is the diagnosis as its JSON has it, *files* are arm and calibration, *comparisons* are
    those of `predictive.curves.compare`.
    """
    arm, units = diagnosis.arm, choose_units(diagnosis.arm)
    sessions = [*diagnosis.sessions, *diagnosis.holdout]
    page = Page(f"Diagnosis of {arm.serial_number}", arm.serial_number)
    word, reason = write_headline(result)
    page.add_verdict(  # a diagnosis has no limit to pass or fail
        word,
        page.abbreviate("Verdict", reason),
        None,
        _write_key_sentence(diagnosis, result, units.length),
    )
    add_head(page, arm, sessions, about)
    _add_overview_table(page, result, units.length)
    add_coverage(page, arm, sessions)
    _add_measured_against_simulated(page, comparisons, units)
    page.add_text(page.abbreviate("Next experiment", f"Next: {result['next_experiment']}"))
    page.add_signature_lines("Measured by", "Checked by")
    page.begin_appendix()
    page.add_text(RULE)
    _add_model_under_test(page, diagnosis, result)
    _add_rest_of_overview(page, comparisons, units)
    touched = len(diagnosis.touched)  # they are the first of the findings
    for number, finding in enumerate(result["findings"][:touched], 1):
        page.add_heading(f"{number}. {name_finding(finding)}")
        page.add_text(finding["reading"])
    for index, finding in enumerate(result["findings"][touched:][: len(diagnosis.findings)]):
        add_finding(page, diagnosis, index, touched + index + 1, finding)
        if comparison := choose_for_finding(comparisons, finding):
            caption = (
                f"What the simulation gets wrong over {comparison.bins.variable}, before and after"
            )
            page.add_figure(draw_rows([comparison], units), caption)
    _add_sets(page, result)
    if diagnosis.outliers:
        page.add_heading("Outliers")
        page.add_table(
            ["session", "row", f"error, {units.length.name}"],
            [
                [o.session, o.row, units.length.format_value(o.error_um / 1e3)]
                for o in diagnosis.outliers
            ],
        )
    _add_remaining(page, diagnosis, result, units)
    _add_undetectable(page, result)
    add_origin(page, arm, sessions, files)
    return page.to_html()


def write_headline(result: dict[str, Any]) -> tuple[str, str]:
    """Return a diagnosis in a few words, and the reason: the causes, or why none is named."""
    findings = result["findings"]
    strange = any(finding["cause"] == "unknown" for finding in findings)
    causes = [finding for finding in findings if finding["cause"] not in NO_CAUSES]
    confirmed = [finding for finding in causes if finding["gain"]["shown"]]
    summary = "; ".join(_describe(finding) for finding in findings)
    if confirmed:
        count = len(confirmed)
        counted_first = "; ".join(_describe(finding) for finding in confirmed)
        uncounted = [_describe(finding) for finding in findings if finding not in confirmed]
        further = f" Not counted: {'; '.join(uncounted)}." if uncounted else ""
        word = "ONE CAUSE FOUND" if count == 1 else f"{count} CAUSES FOUND"
        return word, f"{counted_first}.{further}"
    if causes:
        return "NOT CONFIRMED", f"{summary}."
    if strange or result["unexplained"]["significant"]:
        return "CAUSE UNKNOWN", f"{summary}." if summary else result["verdict"]
    if any(finding["cause"] == "artefact_moved" for finding in findings):
        return "NO CAUSE IN THE ARM", f"{summary}."
    why = result["verdict"].removeprefix("No cause was found. ")
    return "NO CAUSE FOUND", f"Only {summary}." if summary else why


def _describe(finding: dict[str, Any]) -> str:
    """Describe a finding for the reason, with its doubts."""
    if finding["cause"] == "outliers":
        rows = len(finding["rows"])
        return f"{format_count(rows, 'reading')} far from where all others put them"
    if finding["cause"] == "unknown":
        on = ", ".join(finding["depends_on"]) or "nothing that was recorded"
        return f"an error that depends on {on} and fits no known cause"
    doubts = []
    if not finding["gain"]["shown"]:
        doubts.append("held-out readings do not confirm it")
    if (finding.get("explains") or {}).get("guess"):
        doubts.append("the name is a guess")
    return name_finding(finding) + (f" ({', '.join(doubts)})" if doubts else "")


def _write_key_sentence(diagnosis: Diagnosis, result: dict[str, Any], unit: Unit) -> str:
    """Describe the extended model's gain on held-out readings in one sentence, in one unit."""
    before_um, after_um = result["baseline"]["heldout_rms_um"], None
    if diagnosis.written:
        before_um, after_um = diagnosis.written_clear_um or diagnosis.written_rms_um
    unit = unit.scale_to(before_um / 1e3)
    before = f"Held-out readings are missed by {unit.to_text(before_um / 1e3)} (3-D RMS)"
    if after_um is None:
        return f"{before}."
    gained = ""
    if diagnosis.later_gain_um is not None:
        low, high = (unit.to_text(gain_um / 1e3) for gain_um in diagnosis.later_gain_um)
        gained = f" In another session like these it gains {low} to {high} (95 %)."
    return f"{before}, with the extended model by {unit.to_text(after_um / 1e3)}.{gained}"


def _name_finding_briefly(finding: dict[str, Any]) -> str:
    if finding["cause"] == "unknown" and finding["depends_on"]:
        return f"unknown, depends on {', '.join(finding['depends_on'])}"
    return name_finding(finding)


def _add_overview_table(page: Page, result: dict[str, Any], unit: Unit) -> None:
    findings = result["findings"]
    if findings:
        page.add_table(
            ["", "finding", "probability", f"held-out before, {unit.name}",
             f"after, {unit.name}", "confirmed"],
            [
                [
                    str(number),
                    _name_finding_briefly(finding),
                    f"{finding['probability']:.3f}",
                    unit.format_value(finding["gain"]["heldout_rms_um_before"] / 1e3),
                    unit.format_value(finding["gain"]["heldout_rms_um_after"] / 1e3),
                    "yes" if finding["gain"]["shown"] else "no",
                ]
                for number, finding in enumerate(findings[:MOST_FINDINGS], 1)
            ],
        )  # fmt: skip
        if (n_further := len(findings) - MOST_FINDINGS) > 0:
            page.add_text(f"{format_count(n_further, 'further finding')}: Appendix.")
        page.add_text(page.abbreviate("Verdict in words", result["verdict"]))
    figure, panel = make_single_figure(2.2)
    draw_gains(panel, result, unit)
    page.add_figure(figure, GAINS)


def _add_model_under_test(page: Page, diagnosis: Diagnosis, result: dict[str, Any]) -> None:
    readings, sessions = sum(s.n for s in diagnosis.sessions), len(diagnosis.sessions)
    if diagnosis.holdout:
        n_readings = sum(s.n for s in diagnosis.holdout)
        n_sessions = len(diagnosis.holdout)
        heldout = f"{n_readings} readings of {format_count(n_sessions, 'other session')}"
    else:
        heldout = "each placement in turn"
    model = (
        "the calibration given"
        if diagnosis.baseline.is_given
        else "what armd calibrate makes of these sessions"
    )
    page.add_text(
        f"{readings} readings in {format_count(sessions, 'session')}. "
        f"Model under test: {model}. Held out: {heldout}."
    )
    if result["findings"]:
        page.add_text(
            "Each point of the drawing of held-out readings has one finding more than the one "
            "before; whiskers: 95 % of its gain over that one."
        )


def _choose_overview_rows(comparisons: Sequence[ResidualComparison]) -> list[ResidualComparison]:
    """Choose those comparisons of the overview that noise explains least, in the
    overview's order.
    """
    comparisons_overview = choose_overview(comparisons)
    chosen = sorted(comparisons_overview, key=lambda comparison: comparison.order)[:MOST_ROWS]
    return [
        comparison
        for comparison in comparisons_overview
        if any(comparison is choice for choice in chosen)
    ]


def _add_rest_of_overview(
    page: Page, comparisons: Sequence[ResidualComparison], units: Units
) -> None:
    if not comparisons:
        return
    shown_rows = _choose_overview_rows(comparisons)
    if remainder := [
        comparison
        for comparison in choose_overview(comparisons)
        if all(comparison is not row for row in shown_rows)
    ]:
        names = ", ".join(comparison.bins.variable for comparison in remainder)
        page.add_heading(f"Measured against simulated: {names}")
        page.add_figure(draw_rows(remainder, units), f"Mean residual over {names}")


def _add_measured_against_simulated(
    page: Page, comparisons: Sequence[ResidualComparison], units: Units
) -> None:
    """Add the mean residuals with the band of the simulation, before and after the findings.

    Errors of the simulation are outside the band before, and should be inside it after.
    """
    if not comparisons:
        return
    page.add_heading("Measured against simulated")
    page.add_figure(
        draw_rows(_choose_overview_rows(comparisons), units, OVERVIEW_ROW_IN),
        f"Mean residual along a joint's motion ({units.angle.name} at that joint), a link or an "
        "axis: of joint angles, temperatures, time and placements what leaves its band most; the "
        "rest in the appendix",
    )
    page.add_text(
        "Band: 95 % of the data sets that the model gives by the noise found, each refitted as the "
        "readings were; grey: some of them. A point outside of it is what the simulation gets "
        "wrong; 5 % lie there by chance. p: share with as much outside of up to "
        f"{CURVES} such sets."
    )


def _add_sets(page: Page, result: dict[str, Any]) -> None:
    """Add a table of the sets of causes that explain these readings, where there are several."""
    sets = result["sets"]
    if len(sets) < 2 or all(len(cause_set["causes"]) < 2 for cause_set in sets):
        return  # the alternatives of one finding stand beside it
    page.add_heading("Sets of causes")
    page.add_table(
        ["causes", "probability"],
        [
            ["; ".join(map(name_finding, cause_set["causes"])), f"{cause_set['probability']:.3f}"]
            for cause_set in sets
        ],
    )
    page.add_text(
        "The first set is what was found. Each other has one cause renamed, several causes "
        "exchanged, or one cause more; names are taken as independent of each other."
    )


def _add_remaining(page: Page, diagnosis: Diagnosis, result: dict[str, Any], units: Units) -> None:
    page.add_heading("What stays unexplained")
    unexplained, length = result["unexplained"], units.length
    floor = length.to_text(diagnosis.noise_floor_um / 1e3)
    page.add_text(
        f"{length.to_text(diagnosis.remaining_rms_um / 1e3)} 3-D RMS stay in the readings"
        f" used; the noise alone would leave {floor}. "
        + (
            f"What is left is significant and depends on {', '.join(unexplained['depends_on'])}."
            if unexplained["significant"]
            else "Nothing in it is significant "
            f"(p = {diagnosis.search.remaining_p:.2g} for the strongest of all candidates)."
        )
    )
    noise = diagnosis.search.last.noise
    page.add_table(
        ["noise found in these readings", "standard deviation"],
        [
            ["encoders, each", units.angle.to_text(noise.encoder_rad)],
            ["repeat of a point, each axis", length.to_text(noise.repeat_mm)],
            [
                "slow drift of the base, each axis, in some minutes",
                length.to_text(noise.drift_mm),
            ],
        ],
    )
    if len(unexplained["by_target"]) > 1:
        page.add_table(
            [
                "placement",
                "target",
                "rests",
                f"left, 3-D RMS, {length.name}",
                f"largest step, {length.name}",
                "after rest",
            ],
            [
                [
                    target["placement"],
                    target["target"],
                    target["rests"],
                    length.format_value(target["rms_um"] / 1e3),
                    length.format_value(target["step_um"] / 1e3) if target["after"] else "",
                    target["after"] or "",
                ]
                for target in unexplained["by_target"]
            ],
        )
        page.add_text(
            "Step: how far the mean of the first so many rests at a target stands from that of the "
            "others. One much larger than what is left says that seat, artefact or arm moved."
        )


def _add_undetectable(page: Page, result: dict[str, Any]) -> None:
    if not result["cannot_tell"]:
        return
    page.add_heading("What these data cannot tell")
    page.add_text("No size of these causes would show in these readings:")
    page.add_table(
        ["cause", "it needs"],
        [[row["cause"].replace("_", " "), row["needs"]] for row in result["cannot_tell"]],
    )
