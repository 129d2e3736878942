"""Tips calibrated since armd.toml was written: kept in the state folder, and active.

armd.toml belongs to the user, so the daemon does not write it. It stores a tip together with
armd.toml's entry for that tip at that time. The stored tip is active as long as armd.toml has the
same entry: an edit there replaces it.
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
    """One stored tip, and armd.toml's entry at that time (None: no entry)."""

    tip: Tip
    configured: Tip | None = None


class KeptTips(Strict):
    """The content of the file of stored tips."""

    schema_: Literal["armd.tips/1"] = Field("armd.tips/1", alias="schema")
    tips: dict[str, KeptTip] = {}


def locate_tips_file(serial: str) -> Path:
    """Return the path of an arm's file of stored tips."""
    return find_state_folder() / "tips" / f"{quote(serial, safe=' ')}.json"


def load_active_tips(serial: str, configured: Mapping[str, Tip]) -> dict[str, Tip]:
    """Return armd.toml's tips with the stored ones; raises `BadInput` for a damaged file."""
    kept_tips = _read(locate_tips_file(serial)).tips
    hold = {
        name: entry.tip
        for name, entry in kept_tips.items()
        if entry.configured == configured.get(name)
    }
    return {**configured, **hold}


def keep_tip(serial: str, name: str, tip: Tip, configured: Mapping[str, Tip]) -> None:
    """Store a tip; it is on the disk when this returns.

    Raises `BadInput` for a damaged file or too many tips.
    """
    path = locate_tips_file(serial)
    kept_tips = _read(path).tips
    kept_tips[name] = KeptTip(tip=tip, configured=configured.get(name))
    if len(kept_tips) > MOST_KEPT:
        raise BadInput(path, "tips", f"{len(kept_tips)}", f"{MOST_KEPT} at most")
    content = KeptTips(tips=kept_tips).model_dump(mode="json", by_alias=True)
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o750)
    write_whole(path, json.dumps(content, indent=1) + "\n")


def parse_tip(name: str, offset_mm: str, radius_mm: str) -> tuple[str, Tip]:
    """Parse the arguments of the command `keep_tip`; raises `BadInput`.

    *offset_mm* is "x,y,z" in mm, *radius_mm* the ball's radius in mm or nothing.
    """
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
        return word  # `validate` reports it


def _read(path: Path) -> KeptTips:
    if not path.exists():
        return KeptTips()
    return validate(path, load_json_data(path, read_input(path, MOST_TOML_BYTES)), KeptTips)
