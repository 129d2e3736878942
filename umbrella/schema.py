"""Files a person writes, checked; every fault names file, key, found and expected."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from armd.errors import BadInput


class Strict(BaseModel):
    """Base of all file models: unknown keys and non-finite numbers are errors; frozen."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


Model = TypeVar("Model", bound=BaseModel)


def load_toml(path: str | Path, model: type[Model]) -> Model:
    """Read and validate a TOML file; raises `BadInput`."""
    text = _read(path)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise BadInput(path, "TOML", str(error), "a valid TOML file") from error
    return validate(path, data, model)


def load_json(path: str | Path, model: type[Model]) -> Model:
    """Read and validate a JSON file; raises `BadInput`."""
    text = _read(path)
    try:
        data = json.loads(text)
    except json.JSONDecodeError as error:
        where = f"line {error.lineno} column {error.colno}"
        raise BadInput(path, where, error.msg, "valid JSON") from error
    return validate(path, data, model)


def validate(path: str | Path, data: object, model: type[Model]) -> Model:
    """Check parsed *data*; faults become a `BadInput` naming its key, with `more`."""
    # As JSON, because there strict means: "5" is not a number, but a list may be a tuple.
    text = json.dumps(data, default=str)
    try:
        return model.model_validate_json(text, strict=True)
    except ValidationError as error:
        first, *more = (
            BadInput(path, _key(fault["loc"], data) or "the file", *_found_expected(fault, model))
            for fault in error.errors(include_url=False)
        )
        first.more = tuple(more)
        raise first from error


def _read(path: str | Path) -> str:
    try:
        return Path(path).read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise BadInput(path, "the file", "nothing", "an existing file") from error
    except IsADirectoryError as error:
        raise BadInput(path, "the file", "a folder", "a file") from error
    except PermissionError as error:
        raise BadInput(path, "the file", "no permission to read it", "a readable file") from error
    except UnicodeDecodeError as error:
        raise BadInput(path, f"byte {error.start}", "not UTF-8", "UTF-8 text") from error


def _key(location: tuple[int | str, ...], data: object) -> str:
    """`("joint", 2, "a_mm")` reads `joint[3].a_mm`: people count joints from one.

    A part that the data do not hold is the tag of a union, unless it is the last: then it is a
    key that is missing.
    """
    key = ""
    for i, part in enumerate(location):
        if isinstance(data, dict) and part not in data and i < len(location) - 1:
            continue
        if isinstance(data, dict):
            data = data.get(part)
        elif isinstance(data, list) and isinstance(part, int) and part < len(data):
            data = data[part]
        key += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if key else str(part)
    return key


def _found_expected(fault: Any, model: type[BaseModel]) -> tuple[str, str]:
    match fault["type"]:
        case "missing":
            return "nothing", "this key"
        case "extra_forbidden":
            return "an unknown key", "one of the documented keys"
        case "union_tag_invalid":
            return repr(fault["ctx"]["tag"]), f"one of {fault['ctx']['expected_tags']}"
    shown = repr(fault["input"])
    found = shown if len(shown) <= 80 else shown[:77] + "..."
    message = fault["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    return found, message
