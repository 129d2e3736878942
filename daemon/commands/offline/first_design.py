"""`armd design` without sessions: the poses before the first measurement."""

from __future__ import annotations

import argparse
import csv
import io
import json
from typing import Any

import numpy as np
from rich.table import Table

from armd.compensation.data.session_format import Artefact, ArtefactFile
from armd.compensation.design.first import Bounds, FirstExperiment, design_first
from armd.compensation.model.arm import Arm
from armd.compensation.report.written import write_pages
from armd.daemon.commands.offline.given import load_given
from armd.errors import BadInput
from armd.files.schema import load_toml
from armd.files.writing import write_whole
from armd.terminal.aside import aside
from armd.terminal.counted import counted
from armd.terminal.plain import plain_console


def run(args: argparse.Namespace) -> int:
    """The outputs are checked already."""
    bounds = Bounds(_reach(args.reach), args.lowest)
    arm, loaded = load_given(args)
    artefact = load_toml(args.artefact, ArtefactFile).artefact if args.artefact else None
    parameters = arm.nominal() if loaded is None else loaded.content.vector(arm.n_joints)
    with aside(args).status("choosing poses …"):
        experiment = design_first(arm, parameters, args.readings, artefact, bounds)
    rows, words = table(experiment), in_words(experiment)
    if args.output:
        text = io.StringIO()
        writer = csv.DictWriter(text, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
        write_whole(args.output, text.getvalue())
    if args.json:
        write_whole(args.json, json.dumps(_result(experiment, rows), indent=1) + "\n")
    write_pages(args, lambda: _page(args, experiment, arm, rows, words))
    _print(rows, words, artefact)
    return 0


def _reach(given: list[float] | None) -> tuple[float, float] | None:
    if given is None:
        return None
    least, most = given
    if not 0.0 <= least < most < float("inf"):
        found = f"{least:g} {most:g}"
        raise BadInput("--reach", "value", found, "MIN MAX in mm, MIN at least 0 and below MAX")
    return least, most


def table(experiment: FirstExperiment) -> list[dict[str, Any]]:
    """One row per pose: where the tip goes, on which target, and how the arm stands, in degrees for
    a person and in rad as readings have it."""
    rows = []
    for i, (q, tip) in enumerate(zip(experiment.q, experiment.tip_mm, strict=True)):
        row: dict[str, Any] = {"pose": i + 1}
        if experiment.targets:
            row |= {"placement": experiment.placements[i], "target": experiment.targets[i]}
        row |= {f"{a}_mm": round(float(v), 1) for a, v in zip("xyz", tip, strict=True)}
        row |= {f"q{k}_deg": round(float(v), 1) for k, v in enumerate(np.degrees(q), 1)}
        rows.append(row | {f"q{k}": round(float(v), 9) for k, v in enumerate(q, 1)})
    return rows


def in_words(experiment: FirstExperiment) -> list[str]:
    """What the poses are worth, a sentence each."""
    n, most = len(experiment.q), experiment.structural_rank
    where = (
        f"on the artefact in {len(set(experiment.placements))} placements"
        if experiment.placements
        else "seen by a tracker in one placement"
    )
    condition = experiment.condition_number
    indices = ", ".join(f"{name} {v:.3g}" for name, v in experiment.observability.items())
    words = [
        f"{counted(n, 'posture')} for a first calibration, {where};"
        f" a certificate wants {experiment.certificate}.",
        f"Rank {experiment.rank} of {most}, of {experiment.constants} constants: directions known"
        f" to a tenth of 10 mm or 0.02 rad, with {experiment.noise_mm:.2g} mm of noise a reading."
        f" Structural rank {most}: directions that move a point at all.",
        f"Observability {indices}; condition number"
        f" {'infinite' if condition is None else f'{condition:.3g}'}. Columns are scaled by 10 mm"
        " and 0.02 rad, placements and unknown targets eliminated.",
    ]
    words += [f"Not known: {found}." for found in experiment.not_known]
    if experiment.below_base:
        words.append(
            f"In {counted(experiment.below_base, 'posture')} a part of the arm is lower than its"
            " base; `--lowest 0` keeps all of it above."
        )
    return words


def _result(experiment: FirstExperiment, rows: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "schema": "armd.design/1",
        "goal": "determine the constants of the arm",
        "target_kind": "artefact" if experiment.placements else "tracker",
        "readings": len(rows),
        "certificate_readings": experiment.certificate,
        "constants": experiment.constants,
        "rank": experiment.rank,
        "structural_rank": experiment.structural_rank,
        "observability": experiment.observability,
        "condition_number": experiment.condition_number,
        "singular_values_mm": experiment.singular_values.tolist(),
        "noise_mm": experiment.noise_mm,
        "not_known": experiment.not_known,
        "below_base": experiment.below_base,
        "poses": rows,
    }


def _page(
    args: argparse.Namespace,
    experiment: FirstExperiment,
    arm: Arm,
    rows: list[dict[str, Any]],
    words: list[str],
) -> str:
    from armd.compensation.report.first_design import first_design_report  # drawings load slowly

    files = {"arm": args.arm, "calibration": args.calibration, "artefact": args.artefact}
    shown = [{name: v for name, v in row.items() if not _is_rad(name)} for row in rows]
    return first_design_report(experiment, arm, shown, words, files)


def _is_rad(name: str) -> bool:
    return name[0] == "q" and name[1:].isdigit()


def _print(rows: list[dict[str, Any]], words: list[str], artefact: Artefact | None) -> None:
    console = plain_console()
    for sentence in words:
        console.print(sentence, soft_wrap=True)
    places = ["placement", "target"] if artefact else []
    shown = Table("pose", *places, "tip, mm", "joints, °")
    for row in rows:
        shown.add_row(
            str(row["pose"]),
            *(row[name] for name in places),
            " ".join(f"{row[f'{a}_mm']:.0f}" for a in "xyz"),
            " ".join(f"{v:.0f}" for k, v in row.items() if k.endswith("_deg")),
        )
    console.print(shown)
