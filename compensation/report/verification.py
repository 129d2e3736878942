"""The verification as one HTML page."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from armd.compensation.data.session import Session
from armd.compensation.model.arm import Arm
from armd.compensation.report.drawing import COLOURS, one_drawing
from armd.compensation.report.page import Page
from armd.compensation.report.sessions import InputFile, origin
from armd.compensation.verify.limits import PermissibleErrors
from armd.compensation.verify.verdict import COVERAGE_FACTOR, NOT_STATED, Judged, Verdict

#: Of fewer results a table says as much.
WORTH_A_DRAWING = 4
#: Stands where a result has no certified length.
NO_LENGTH = "–"


def verification_report(
    verdict: Verdict, session: Session, arm: Arm, files: Mapping[str, InputFile | None]
) -> str:
    """HTML text of the report; *files*: arm, calibration and limits, None where there is none."""
    page = Page(f"Verification of arm {arm.serial_number}")
    _verdict(page, verdict)
    page.text(f"Decision rule: {verdict.rule}.")
    page.table(
        [
            "figure", "standard", "largest, µm", "at", "deciding, µm", "at", "MPE, µm", "U, µm",
            "outcome",
        ],
        [_row(item) for item in verdict.judged],
    )  # fmt: skip
    page.text(
        "Largest: the largest in size. Deciding: nearest its limit or farthest beyond it. Limits"
        " and uncertainties may differ from one result to the next; those shown are the deciding"
        " result's own. U: expanded uncertainty (k = 2) of the test, not of the arm, from the"
        " certified lengths, the artefact's temperature, the form of sphere and seat."
    )
    untested = [
        f"{key}: {'though it has a limit: ' * (key in verdict.not_tested)}{reason}"
        for key, reason in verdict.verification.left_out.items()
    ]
    if untested:
        page.heading("Not tested")
        page.items(untested)
    if verdict.remarks:
        page.heading("Remarks")
        page.items(verdict.remarks)
    for item in verdict.judged:
        page.heading(f"{item.figure.name}: every result")
        if len(item.figure.deviations) >= WORTH_A_DRAWING:
            page.figure(
                _by_length(item, verdict.limits),
                f"{item.figure.name}: error of each result over its length, µm; dashed: the MPE",
            )
        page.table(["result", "length, mm", "error, µm", "U (k = 2), µm"], _results(item))
    offset = ", ".join(f"{value:g}" for value in arm.tip.offset_mm)
    facts = {"tip as arm.toml has it": f"{offset} mm, radius {arm.tip.radius_mm:g} mm"}
    if not files.get("calibration"):
        facts["calibration"] = "none: nominal geometry of arm.toml"
    origin(page, arm, [session], files, facts)
    page.signatures("Measured by", "Checked by")
    return page.html()


def _verdict(page: Page, verdict: Verdict) -> None:
    word, _, reason = verdict.in_words.partition(" ")
    if verdict.limits is None:
        page.verdict("NO VERDICT", "No limits were given: the figures below are not judged.", None)
    else:
        page.verdict(word.rstrip(":"), reason, verdict.passed)


def _results(item: Judged) -> list[list[str]]:
    return [
        [
            deviation.where,
            f"{deviation.length_mm:.3f}" if deviation.length_mm else NO_LENGTH,
            f"{1e3 * deviation.value_mm:+.2f}",
            f"{1e3 * COVERAGE_FACTOR * deviation.standard_uncertainty_mm:.2f}"
            if deviation.standard_uncertainty_mm
            else NOT_STATED,
        ]
        for deviation in item.figure.deviations
    ]


def _row(item: Judged) -> list[str]:
    return [
        item.figure.name,
        item.figure.standard,
        f"{1e3 * item.figure.worst.value_mm:+.2f}",
        item.figure.worst.where,
        f"{1e3 * item.deciding.value_mm:+.2f}",
        item.deciding.where,
        "" if item.limit_mm is None else f"{1e3 * item.limit_mm:.2f}",
        item.uncertainty_um(2).removesuffix(" µm"),
        item.outcome,
    ]


def _by_length(item: Judged, limits: PermissibleErrors | None) -> Figure:
    lengths = [deviation.length_mm for deviation in item.figure.deviations]
    figure, panel = one_drawing()
    panel.plot(
        lengths, [1e3 * deviation.value_mm for deviation in item.figure.deviations], "o",
        markersize=4,
    )  # fmt: skip
    if limits is not None and item.limit_mm is not None:
        ends = [min(lengths), max(lengths)]
        for sign in (-1, 1):
            limit = [sign * 1e3 * (limits.mpe.of(item.figure.key, at) or 0.0) for at in ends]
            panel.plot(ends, limit, "--", color=COLOURS[1])
    panel.set(xlabel="length, mm", ylabel="error, µm")
    return figure
