"""Suggests the nearest known word for an unknown one."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pydantic import BaseModel

#: Below this similarity (difflib's ratio) a suggestion is a guess: `q9` for `q1` has 0.5,
#: `alfa_deg` for `alpha_deg` 0.82, a word of six letters without one of them 0.91.
ALIKE = 0.7
#: The most words in one line.
MOST_SHOWN = 12
#: The most files of a folder that are compared, in some milliseconds.
MOST_COMPARED = 500


def suggest(word: str, known_names: Iterable[str]) -> str:
    """Return `: did you mean alpha_deg?`, or an empty text."""
    like = find_nearest(word, known_names)
    return f": did you mean {like}?" if like else ""


def find_nearest(word: str, known_names: Iterable[str]) -> str | None:
    """Return the one of *known_names* that is most similar to *word*, if one is similar."""
    by_lower = {name.lower(): name for name in known_names}
    matches = difflib.get_close_matches(word.lower(), by_lower, 1, ALIKE)
    return by_lower[matches[0]] if matches else None


def suggest_names(word: str, known_names: Iterable[str]) -> str:
    """Return `: did you mean alpha_deg?`, or if none is similar, `: theta_deg, d_mm, …`."""
    names = list(known_names)
    return suggest(word, names) or (f": {format_names(names)}" if names else "")


def suggest_path(path: Path) -> str:
    """Return `: did you mean src/T20?` for a path that does not exist, or an empty text."""
    like = find_nearest(path.name, _names(path.parent))
    return f": did you mean {path.parent / like}?" if like else ""


def list_folder(folder: Path) -> str:
    """Return the files of a folder, as ` (it has arm.toml, armd.toml)`, or an empty text."""
    files = sorted(name for name in _names(folder) if (folder / name).is_file())
    return f" (it has {format_names(files)})" if files else ""


def _names(folder: Path) -> list[str]:
    try:
        with os.scandir(folder) as entries:
            return [entry.name for entry in islice(entries, MOST_COMPARED)]
    except (OSError, ValueError):
        return []


def format_names(names: Iterable[str]) -> str:
    """Return all names in one line, or the first of them."""
    listed = list(names)
    return ", ".join(listed[:MOST_SHOWN]) + (", …" if len(listed) > MOST_SHOWN else "")


def list_keys_at(model: type[BaseModel], location: Iterable[int | str]) -> list[str]:
    """List the keys that *model* knows in the table at *location*.

    *location* is that of a pydantic error: keys, numbers of list elements, tags of unions.
    """
    schema = model.model_json_schema(by_alias=True)
    tables = list(_resolved(schema, schema))
    for part in location:
        tables = [
            below
            for table in tables
            for child in _children(table, part)
            for below in _resolved(child, schema)
        ]
    return list(dict.fromkeys(key for table in tables for key in table.get("properties", {})))


def _children(table: dict[str, Any], part: int | str) -> Iterator[dict[str, Any]]:
    if isinstance(part, int):
        if isinstance(table.get("items"), dict):
            yield table["items"]
    elif part in table.get("properties", {}):
        yield table["properties"][part]
    elif isinstance(table.get("additionalProperties"), dict):
        yield table["additionalProperties"]
    elif any(
        part == alternative.get("const") for alternative in table.get("properties", {}).values()
    ):
        yield table  # the tag of a union with this member


def _resolved(table: dict[str, Any], schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the tables without references and alternatives."""
    if "$ref" in table:
        name = table["$ref"].removeprefix("#/$defs/")
        yield from _resolved(schema["$defs"][name], schema)
    for word in ("anyOf", "oneOf", "allOf"):
        for alternative in table.get(word, []):
            yield from _resolved(alternative, schema)
    yield table
