"""Spoils measurements by errors that are not the arm's: those of a workshop and an office.

Some occur during measurement (`spoil_campaign`: a gross error, noise that is not white, a moved
artefact), some in the files afterwards (`spoil_files`: duplicate rows, a broken channel, wrong
clocks). Held-out sessions, which judge a result, have neither.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta

import numpy as np

from armd.arrays import F64
from armd.simulator.measured.campaign import Campaign, Touched
from armd.simulator.measured.electronics import draw_brown_outs, draw_restarts
from armd.simulator.truth.nominal import list_sensor_names
from armd.simulator.truth.rotations import draw_directions

Rng = np.random.Generator
Texts = dict[str, str]  # session.toml and readings.csv
TableRows = list[dict[str, str]]

#: 100 times the noise of a reading (7 µm, 3-D).
GROSS_UM, GROSS_SHARE = 700.0, 0.03
#: The error that copies of a posture share: twice the encoders' noise.
INTERPOLATION_ARCSEC = 3.0
KINDS = (
    "gross",
    "t3",
    "correlated",
    "touched",
    "doubled",
    "dead",
    "coarse",
    "clocks",
    "power_on",
    "restarted",
    "repeats",
)


def spoil_campaign(campaign: Campaign, kind: str, rng: Rng) -> Campaign:
    """Return the campaign with a mess during measurement; other kinds do not change it."""
    rig = campaign.rig
    names = [plan.name for plan, _ in campaign.sessions if not plan.held_out]
    match kind:
        case "gross":

            def spoil(row_rng: Rng, n: int) -> F64:
                offset_mm = (
                    1e-3
                    * GROSS_UM
                    * row_rng.uniform(0.7, 1.5, (n, 1))
                    * draw_directions(row_rng, n)
                )
                return np.where(row_rng.uniform(size=(n, 1)) < GROSS_SHARE, offset_mm, 0.0)

            rig = replace(rig, spoil=spoil)
        case "t3":
            rig = replace(rig, noise=replace(rig.noise, tails="t3"))
        case "correlated":
            rig = replace(rig, noise=replace(rig.noise, correlation=float(rng.uniform(0.4, 0.8))))
        case "coarse":
            rig = replace(rig, noise=replace(rig.noise, sensor_step_c=0.0625))
        case "power_on":
            rig = replace(rig, brown_outs=draw_brown_outs(rng, names, len(list_sensor_names())))
        case "restarted":
            rig = replace(rig, restarts=draw_restarts(rng, names, len(rig.limits_rad[0])))
        case "repeats":  # an operator who reads each posture three times
            small = np.radians(INTERPOLATION_ARCSEC / 3600.0)
            rounds = bool(rng.uniform() < 0.5)
            rig = replace(rig, repeats=3, in_rounds=rounds, interpolation_rad=float(small))
        case "touched":
            distance_mm = 1e-3 * float(np.exp(rng.uniform(np.log(100.0), np.log(600.0))))
            turn = 1e-3 * rng.uniform(0.0, 1.0) * draw_directions(rng, 1)[0]
            shift = distance_mm * draw_directions(rng, 1)[0]
            touched = Touched(str(rng.choice(names)), float(rng.uniform(0.25, 0.75)), turn, shift)
            rig = replace(rig, touched=touched)
    return replace(campaign, rig=rig)


def spoil_files(kind: str, sessions: list[Texts], rng: Rng) -> list[Texts]:
    """Return the sessions' files with a mess in them; other kinds do not change them."""
    match kind:
        case "doubled":
            return [_table(texts, lambda rows: _doubled(rows, rng)) for texts in sessions]
        case "dead":
            return _dead(sessions, rng)
        case "clocks":
            return _clocks(sessions, rng)
    return sessions


def _doubled(rows: TableRows, rng: Rng) -> TableRows:
    """Duplicate a tenth of the rows: each at once, or all at the end."""
    again = rng.uniform(size=len(rows)) < 0.1
    if rng.uniform() < 0.5:
        return rows + [row for row, twice in zip(rows, again, strict=True) if twice]
    return [row for row, twice in zip(rows, again, strict=True) for _ in range(1 + int(twice))]


def _dead(sessions: list[Texts], rng: Rng) -> list[Texts]:
    """Break one channel: stuck or empty from some row on, constant, or missing throughout."""
    name = str(rng.choice(list_sensor_names()[1:4]))
    how = str(rng.choice(["stuck", "constant", "empty", "missing"]))
    since = int(rng.integers(len(sessions) // 2)) if how in ("stuck", "empty") else 0
    fixed = str(rng.choice(["0", "85", "20"]))
    last = ""
    changed = []
    for i, texts in enumerate(sessions):

        def change(rows: TableRows, i: int = i) -> TableRows:
            nonlocal last
            first = 0 if i > since or how in ("constant", "missing") else len(rows) // 2
            first = len(rows) if i < since else first
            for j, row in enumerate(rows):
                if how == "missing":
                    del row[name]
                elif j < first:
                    last = row[name]
                else:
                    row[name] = {"stuck": last, "constant": fixed, "empty": ""}[how]
            return rows

        changed.append(_table(texts, change))
    return changed


def _clocks(sessions: list[Texts], rng: Rng) -> list[Texts]:
    """Spoil clocks: two exchanged session starts, overlapping sessions, or a clock set back.

    The latter goes back by an hour during a session.
    """
    how = str(rng.choice(["exchanged", "overlap", "back"]))
    a, b = sorted(int(i) for i in rng.choice(len(sessions), 2, replace=False))
    changed = list(sessions)
    if how == "back":
        changed[a] = _table(changed[a], _set_back)
        return changed
    began = [_started(texts) for texts in sessions]
    if how == "exchanged":
        changed[a], changed[b] = _begun(changed[a], began[b]), _begun(changed[b], began[a])
    else:
        changed[b] = _begun(changed[b], began[b - 1] + timedelta(minutes=5))
    return changed


def _set_back(rows: TableRows) -> TableRows:
    for row in rows[len(rows) // 2 :]:
        row["time_s"] = f"{float(row['time_s']) - 3600.0:.3f}"
    return rows


def _started(texts: Texts) -> datetime:
    line = next(x for x in texts["session.toml"].splitlines() if x.startswith("started"))
    return datetime.fromisoformat(line.partition("= ")[2].replace("Z", "+00:00"))


def _begun(texts: Texts, moment: datetime) -> Texts:
    lines = [
        f"started = {moment:%Y-%m-%dT%H:%M:%SZ}" if line.startswith("started") else line
        for line in texts["session.toml"].splitlines()
    ]
    return {**texts, "session.toml": "\n".join(lines) + "\n"}


def _table(texts: Texts, change: Callable[[TableRows], TableRows]) -> Texts:
    rows = change(list(csv.DictReader(io.StringIO(texts["readings.csv"]))))
    out = io.StringIO()
    writer = csv.DictWriter(out, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return {**texts, "readings.csv": out.getvalue()}
