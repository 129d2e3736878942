"""Writes plain data as TOML that people read and edit: each list on one line
(docs/developer/libraries.md).
"""

from __future__ import annotations

import datetime
import json
from collections.abc import Mapping
from typing import Any


def format_toml(content: Mapping[str, Any]) -> str:
    """Return the text of a file: values first, then tables and arrays of tables in their order.

    Values are strings, numbers, truth values, instants, and lists and mappings of these.
    """
    return "\n".join(_lines(content, "")) + "\n"


def _lines(content: Mapping[str, Any], within: str) -> list[str]:
    lines, below = [], []
    for key, value in content.items():
        name = f"{within}{_key(key)}"
        if isinstance(value, list) and value and all(isinstance(row, Mapping) for row in value):
            for row in value:
                below += ["", f"[[{name}]]", *(f"{_key(k)} = {_value(v)}" for k, v in row.items())]
        elif isinstance(value, Mapping) and not within:
            below += ["", f"[{name}]", *_lines(value, f"{name}.")]
        else:
            lines.append(f"{_key(key)} = {_value(value)}")
    return lines + below


def _key(key: str) -> str:
    bare = key.isascii() and key.replace("-", "_").replace("_", "a").isalnum()
    return key if bare else _value(key)


def _value(value: Any) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case int():
            return str(int(value))
        case float():
            return repr(float(value))  # inf and nan are TOML's words, too
        case str():
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case datetime.datetime():
            return value.isoformat()
        case Mapping():
            return "{ " + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + " }"
        case _:
            return "[" + ", ".join(_value(item) for item in value) + "]"
