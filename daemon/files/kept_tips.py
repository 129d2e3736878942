"""Tips calibrated since armd.toml was written: kept in the state folder, and in force from there.

armd.toml is a person's file; the daemon writes none of it. What it keeps of a tip stands beside
what armd.toml said of that tip then, and holds for as long as armd.toml says the same: who edits
the tip there means it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

from pydantic import Field

from armd.daemon.config import Tip
from armd.errors import BadInput
from armd.files.inputs import MOST_TOML_BYTES, read_input
from armd.files.schema import Strict, load_json_data, validate
from armd.files.state_folder import find_state_folder
from armd.files.writing import write_whole

LONGEST_NAME = 80
MOST_KEPT = 100


class KeptTip(Strict):
    """One tip: what it is now, and what armd.toml had in its place (None: nothing)."""

    tip: Tip
    configured: Tip | None = None


class KeptTips(Strict):
    """The content of the file."""

    schema_: Literal["armd.tips/1"] = Field("armd.tips/1", alias="schema")
    tips: dict[str, KeptTip] = {}


def locate_tips_file(serial: str) -> Path:
    """Of one arm."""
    return find_state_folder() / "tips" / f"{quote(serial, safe=' ')}.json"


def load_active_tips(serial: str, configured: Mapping[str, Tip]) -> dict[str, Tip]:
    """armd.toml's tips, with those kept since; raises `BadInput` for a damaged file."""
    kept_tips = _read(locate_tips_file(serial)).tips
    hold = {
        name: entry.tip
        for name, entry in kept_tips.items()
        if entry.configured == configured.get(name)
    }
    return {**configured, **hold}


def keep_tip(serial: str, name: str, tip: Tip, configured: Mapping[str, Tip]) -> None:
    """On the disk when this returns; raises `BadInput` where it cannot be."""
    path = locate_tips_file(serial)
    kept_tips = _read(path).tips
    kept_tips[name] = KeptTip(tip=tip, configured=configured.get(name))
    if len(kept_tips) > MOST_KEPT:
        raise BadInput(path, "tips", f"{len(kept_tips)}", f"{MOST_KEPT} at most")
    content = KeptTips(tips=kept_tips).model_dump(mode="json", by_alias=True)
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o750)
    write_whole(path, json.dumps(content, indent=1) + "\n")


def parse_tip(name: str, offset_mm: str, radius_mm: str) -> tuple[str, Tip]:
    """Of the command `keep_tip`: "x,y,z" in mm, and the ball's radius in mm or nothing. Raises
    `BadInput`."""
    source = "the command keep_tip"
    if not (0 < len(name) <= LONGEST_NAME and name.isprintable() and name != "-"):
        problem, expected = repr(name)[:100], f"a name of {LONGEST_NAME} letters at most, not -"
        raise BadInput(source, "name", problem, expected)
    content: dict[str, Any] = {"offset_mm": [_parse_number(word) for word in offset_mm.split(",")]}
    if radius_mm:
        content["radius_mm"] = _parse_number(radius_mm)
    return name, validate(source, content, Tip)


def _parse_number(word: str) -> float | str:
    try:
        return float(word)
    except ValueError:
        return word  # which `validate` tells of


def _read(path: Path) -> KeptTips:
    if not path.exists():
        return KeptTips()
    return validate(path, load_json_data(path, read_input(path, MOST_TOML_BYTES)), KeptTips)
