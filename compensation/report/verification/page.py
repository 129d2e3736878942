"""The verification as one HTML page."""

from __future__ import annotations

from collections.abc import Mapping

from armd.compensation.data.sessions.session import Session
from armd.compensation.model.arm import Arm
from armd.compensation.report.coverage import add_coverage
from armd.compensation.report.layout.about import About
from armd.compensation.report.layout.head import add_head
from armd.compensation.report.layout.page import Page
from armd.compensation.report.layout.units import Unit, choose_units
from armd.compensation.report.sessions import InputFile, add_origin
from armd.compensation.report.verification import figures
from armd.compensation.verify.figures import BLOCK, TESTS
from armd.compensation.verify.verdict import COVERAGE_FACTOR, NOT_STATED, Judged, Verdict
from armd.terminal.counted import format_count

#: The figures of both standards; a gauge block against its certificate is not one of them.
ALL_FIGURES = sum(len(keys) for keys in TESTS if keys != (BLOCK,))
#: The sign for a result without a certified length.
NO_LENGTH = "–"


def make_verification_report(
    verdict: Verdict,
    session: Session,
    arm: Arm,
    files: Mapping[str, InputFile | None],
    about: About | None = None,
) -> str:
    """Make the report as HTML text.

    *files* are arm, calibration and limits, None if there is none.
    """
    page, unit = (
        Page(f"Verification of arm {arm.serial_number}", arm.serial_number),
        _choose_unit(arm),
    )
    _add_verdict(page, verdict, unit)
    add_head(page, arm, [session], about)
    page.add_text(f"Decision rule: {verdict.rule}.")
    page.add_table(
        ["figure", "standard", f"deciding, {unit.name}", "at", f"MPE, {unit.name}",
         f"U, {unit.name}", "outcome"],
        [_make_row(item, unit) for item in verdict.judged],
    )  # fmt: skip
    untested = [f"{key}: {reason}" for key, reason in verdict.not_tested.items()]
    page.add_items_in_brief("Not tested, though it has a limit", untested)
    page.add_items_in_brief("Remarks", verdict.remarks)
    for item in verdict.judged:
        if item.figure.key == "e_uni":
            _add_lengths(page, item, verdict, unit)
    add_coverage(page, arm, [session])
    page.add_signature_lines("Measured by", "Checked by")
    page.begin_appendix()
    _add_explanation(page, verdict, unit)
    for item in verdict.judged:
        page.add_heading(f"{item.figure.name}: every result")
        _draw(page, item, verdict, unit)
        page.add_table(
            ["result", "length, mm", f"error, {unit.name}", f"U (k = 2), {unit.name}"],
            _list_results(item, unit),
        )
    add_origin(page, arm, [session], files)
    return page.to_html()


def _add_lengths(page: Page, item: Judged, verdict: Verdict, unit: Unit) -> None:
    page.add_figure(
        figures.draw_lengths(item, verdict.limits, unit),
        f"{item.figure.name}: error of each length with ± U (k = 2), {unit.name}; a colour for"
        " each placement; green: within the MPE",
    )


def _draw(page: Page, item: Judged, verdict: Verdict, unit: Unit) -> None:
    """Add the drawing that suits the figure, if it shows more than its table."""
    name = item.figure.name
    if item.figure.key == "spat_max" and (figure := figures.draw_rosettes(item, unit)):
        caption = f"{name}: each articulation about the mean of its seat; dashed: the MPE"
        page.add_figure(figure, f"{caption}; above: x and y, below: x and z")
    elif item.figure.key == "p_form" and (figure := figures.draw_sphere_form(item, unit)):
        page.add_figure(
            figure, f"{name}: each point's distance from the fitted sphere, {unit.name}"
        )
    elif item.figure.key in ("volumetric_max", BLOCK):
        _add_lengths(page, item, verdict, unit)


def _choose_unit(arm: Arm) -> Unit:
    return choose_units(arm).length


def _add_verdict(page: Page, verdict: Verdict, unit: Unit) -> None:
    if verdict.limits is None:
        reason = "No limits were given: the figures below are not judged."
        page.add_verdict("NO VERDICT", reason, None)
        return
    keys = {item.figure.key for item in verdict.judged if item.outcome != "not judged"}
    covered = len(keys - {BLOCK})
    extent = "full test" if covered == ALL_FIGURES else "partial test"
    blocks = ", and gauge blocks" if BLOCK in keys else ""
    page.add_verdict(
        "ACCEPTED" if verdict.passed else "NOT ACCEPTED",
        f"{covered} of {ALL_FIGURES} figures, {extent}{blocks}",
        verdict.passed,
        _write_key_sentence(verdict, unit),
    )


def _write_key_sentence(verdict: Verdict, unit: Unit) -> str:
    """Describe the deciding figure: the one nearest its limit, or farthest beyond it."""
    decided = [item for item in verdict.judged if item.limit_mm]
    failed = [item for item in decided if item.outcome != "conforms"]
    if not decided:
        return "No figure with a limit was tested."
    worst = max(failed or decided, key=lambda item: abs(item.deciding.value_mm) / _get_limit(item))
    value_mm, limit_mm = worst.deciding.value_mm, _get_limit(worst)
    unit = unit.scale_to(value_mm, limit_mm)
    sentence = f"{unit.to_text(value_mm, '+')} of {unit.to_text(limit_mm)} permitted"
    if failed:
        return f"{worst.figure.name} {_describe_outcome(worst)}: {sentence}."
    if missing := len(verdict.not_tested):
        was = "was" if missing == 1 else "were"
        return f"{format_count(missing, 'figure')} with a limit {was} not tested."
    return f"{worst.figure.name} is nearest its limit: {sentence}."


def _get_limit(item: Judged) -> float:
    return item.limit_mm or 1.0


def _describe_outcome(item: Judged) -> str:
    return "is not proven" if item.outcome == "not proven" else item.outcome


def _add_explanation(page: Page, verdict: Verdict, unit: Unit) -> None:
    page.add_text(f"The verdict in full: {verdict.in_words}.")
    page.add_text(
        "Deciding: nearest its limit or farthest beyond it; largest: the largest in size. Limits"
        " and uncertainties may differ from one result to the next; those shown are the deciding"
        " result's own. U: expanded uncertainty (k = 2) of the test, not of the arm, from the"
        " certified lengths, the artefact's temperature, the form of sphere and seat."
    )
    page.add_table(
        ["figure", f"largest, {unit.name}", "at"],
        [
            [
                item.figure.name,
                unit.format_value(item.figure.worst.value_mm, "+"),
                item.figure.worst.label,
            ]
            for item in verdict.judged
        ],
    )
    untested = [
        f"{key}: {reason}"
        for key, reason in verdict.verification.left_out.items()
        if key not in verdict.not_tested
    ]
    if untested:
        page.add_heading("Not tested")
        page.add_items(untested)


def _list_results(item: Judged, unit: Unit) -> list[list[str]]:
    return [
        [
            deviation.label,
            f"{deviation.length_mm:.3f}" if deviation.length_mm else NO_LENGTH,
            unit.format_value(deviation.value_mm, "+"),
            unit.format_value(COVERAGE_FACTOR * deviation.standard_uncertainty_mm)
            if deviation.standard_uncertainty_mm
            else NOT_STATED,
        ]
        for deviation in item.figure.deviations
    ]


def _make_row(item: Judged, unit: Unit) -> list[str]:
    has_uncertainty = item.uncertainty_stated
    return [
        item.figure.name,
        item.figure.standard,
        unit.format_value(item.deciding.value_mm, "+"),
        item.deciding.label,
        "" if item.limit_mm is None else unit.format_value(item.limit_mm),
        unit.format_value(item.expanded_uncertainty_mm) if has_uncertainty else NOT_STATED,
        item.outcome,
    ]
