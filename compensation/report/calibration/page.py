"""The report of `armd calibrate`: the decision on two pages, then an appendix for auditors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.compensation.data.sessions.session import Session
from armd.compensation.identify.certificate import RULE
from armd.compensation.identify.result import Result
from armd.compensation.model.calibration import LoadedCalibration
from armd.compensation.report.calibration import figures, tables
from armd.compensation.report.coverage import add_coverage
from armd.compensation.report.layout.about import About
from armd.compensation.report.layout.head import add_head
from armd.compensation.report.layout.page import Page
from armd.compensation.report.layout.units import Units, choose_units
from armd.compensation.report.sessions import InputFile, add_origin

#: The most notes before the appendix.
MOST_NOTES = 4


def make_calibration_report(
    result: Result,
    sessions: Sequence[Session],
    arm_file: InputFile,
    written: LoadedCalibration,
    about: About | None = None,
) -> str:
    """Make the whole HTML file; *written* is the calibration as it was written to the disk."""
    arm = result.fit.observations.arm
    units = choose_units(arm)
    page = Page(f"Calibration of {arm.serial_number}", arm.serial_number)
    _add_verdict(page, result, units)
    add_head(page, arm, sessions, about)
    _add_summary(page, result, units)
    page.add_items_in_brief("Notes", result.notes, MOST_NOTES)
    figures.draw_before_and_after(page, result, units.length)
    add_coverage(page, arm, sessions)
    page.add_signature_lines("Calibrated by", "Checked by")
    page.begin_appendix()
    page.add_text(f"Decision rule: {RULE}.")
    tables.add_lengths(page, result, units.length)
    tables.add_not_identifiable(page, result)
    figures.draw_arm(page, result.fit)
    tables.add_parameters_and_terms(page, result, units)
    tables.add_correlations(page, result.fit)
    figures.draw_residual_vectors(page, result.fit, units.length)
    figures.draw_signed_residuals(page, result.fit, units)
    tables.add_thermal_trials(page, result, units.length)
    tables.add_outliers(page, result, units.length)
    _add_provenance(page, result, sessions, arm_file, written)
    return page.to_html()


def _add_verdict(page: Page, result: Result, units: Units) -> None:
    record, heldout_mm = result.certificate, result.heldout.rms_um / 1e3
    good = (True if record.scale_known else None) if record.granted else False
    why = page.abbreviate("Verdict", f"{record.kind}: {record.why_and_next()}")
    missed = units.length.scale_to(heldout_mm).to_text(heldout_mm)
    key = f"Readings that took no part in the fit are missed by {missed} (3-D RMS)."
    page.add_verdict(record.word.upper(), why, good, key)


def _add_summary(page: Page, result: Result, units: Units) -> None:
    fit, noise, length = result.fit, result.fit.noise, units.length
    page.add_table(
        ["", "value", "unit"],
        [
            ["residual, 3-D RMS", length.format_value(result.rms_um / 1e3), length.name],
            [f"{result.held_out_in_words} left out in turn, 3-D RMS",
             length.format_value(result.heldout.rms_um / 1e3), length.name],
            ["readings", fit.observations.n, ""],
            ["placements", len(np.unique(fit.observations.placement)), ""],
            ["rank", f"{fit.solution.rank} of {len(fit.unknowns.names)} unknowns", ""],
            ["noise of an encoder", units.angle.format_value(noise.encoder_rad), units.angle.name],
            ["noise of a reading, per axis", length.format_value(noise.reading_mm), length.name],
            ["thermal order", result.thermal_order, ""],
        ],
    )  # fmt: skip


def _add_provenance(
    page: Page,
    result: Result,
    sessions: Sequence[Session],
    arm_file: InputFile,
    written: LoadedCalibration,
) -> None:
    provenance = result.calibration.provenance
    facts = {
        "calibration written": f"{written.path.name}, SHA-256 {written.sha256}",
        "command": f"{provenance['command']} (armd {provenance['version']})",
    }
    add_origin(page, result.fit.observations.arm, sessions, {"arm": arm_file}, facts)
