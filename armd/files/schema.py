"""Checks files that users write; every error names file, key, found and expected."""

from __future__ import annotations

import codecs
import json
import re
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from armd.errors import BadInput, join_faults
from armd.files.inputs import MOST_JSON_BYTES, MOST_TOML_BYTES, read_input
from armd.printable import escape_invisible, to_printable
from armd.terminal.suggest import find_nearest, format_names, list_keys_at, suggest_names


class Strict(BaseModel):
    """Base of all file models: unknown keys and non-finite numbers are errors; frozen."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


Content = TypeVar("Content", bound=BaseModel)

#: The most values of a file: each may have its own error of 2 kB. A covariance of 300 parameters
#: has 90,000.
MOST_VALUES = 100_000
MOST_FAULTS = 100
MOST_DOTS = 1000
INTEGER_BITS = 63
#: The most letters of a found value.
MOST_SHOWN = 80
#: The usual name of a file with this schema.
FILES = {
    "'armd.arm/1'": "an arm.toml",
    "'armd.daemon/1'": "an armd.toml",
    "'armd.session/1'": "a session.toml",
    "'armd.mpe/1'": "limits for armd verify",
    "'armd.about/1'": "the head of a report",
    "'armd.scenario/1'": "a scenario of armd simulate",
    "'armd.calibration/1'": "a calibration",
    "'armd.diagnosis/1'": "the result of armd diagnose",
}

#: A number of TOML with a decimal comma.
_DECIMAL_COMMA = re.compile(r"\s*[\w.\"-]+\s*=\s*([+-]?\d+),(\d+)\s*(?:#.*)?$")

#: Byte order marks, which editors on Windows put before a text.
MARKS = {codecs.BOM_UTF8: "UTF-8", codecs.BOM_UTF16_LE: "UTF-16", codecs.BOM_UTF16_BE: "UTF-16"}

#: The type of a `PydanticCustomError` with which a model's own check names a key: its context has
#: `key`, `found` and `expected`.
KEY_FAULT = "armd_key"


def load_toml(path: str | Path, model: type[Content]) -> Content:
    """Read and validate a TOML file; raises `BadInput`."""
    return parse_toml(path, read_input(path, MOST_TOML_BYTES), model)


def load_json(path: str | Path, model: type[Content]) -> Content:
    """Read and validate a JSON file; raises `BadInput`."""
    return parse_json(path, read_input(path, MOST_JSON_BYTES), model)


def parse_toml(path: str | Path, content: bytes, model: type[Content]) -> Content:
    """Validate *content*, the bytes of the TOML file *path*; raises `BadInput`."""
    return validate(path, decode_toml(path, content), model)


def parse_json(path: str | Path, content: bytes, model: type[Content]) -> Content:
    """Validate *content*, the bytes of the JSON file *path*; raises `BadInput`."""
    return validate(path, load_json_data(path, content), model)


def decode_toml(path: str | Path, content: bytes) -> dict[str, Any]:
    """Return the tables of a TOML file, not checked by a model; raises `BadInput`."""
    text = _text(path, content)
    dots = max(line.count(".") for line in text.split("\n"))
    if dots > MOST_DOTS:  # tomllib needs n² steps for a key of n parts
        raise BadInput(path, "TOML", f"a line with {dots} dots", f"{MOST_DOTS} at most")
    try:
        data = tomllib.loads(text)
        _refuse_long_integers(path, "", data)
        return data
    except tomllib.TOMLDecodeError as error:
        for number, line in enumerate(text.split("\n"), 1):
            if comma := _DECIMAL_COMMA.match(line):
                expected = f"a decimal point: {comma[1]}.{comma[2]}"
                raise BadInput(path, f"line {number}", repr(line.strip()), expected) from error
        raise BadInput(path, "TOML", str(error), "a valid TOML file") from error
    except (RecursionError, ValueError) as error:
        raise _hostile(path, error) from error


def _refuse_long_integers(path: str | Path, location: str, value: Any) -> None:
    """Raise `BadInput` for integers over 64 bits, the limit of TOML.

    Python's parser accepts any number of hexadecimal digits, and such a number cannot be written as
    decimal text afterwards.
    """
    if isinstance(value, dict):
        for key, below in value.items():
            _refuse_long_integers(path, f"{location}.{key}" if location else key, below)
    elif isinstance(value, list):
        for i, below in enumerate(value, 1):
            _refuse_long_integers(path, f"{location}[{i}]", below)
    elif isinstance(value, int) and value.bit_length() > INTEGER_BITS:
        size = f"an integer of {value.bit_length()} bits"
        raise BadInput(path, location, size, "at most 63 bits and a sign, as TOML has it")


def load_json_data(path: str | Path, content: bytes) -> Any:
    """Return the value of a JSON file, not checked by a model; raises `BadInput`."""
    text = _text(path, content)
    try:
        return decode_json_text(text)
    except KeyTwice as error:
        raise BadInput(path, error.key, error.description, "it once") from error
    except json.JSONDecodeError as error:
        position = f"line {error.lineno} column {error.colno}"
        rest_of_line = text[error.pos :].split("\n", 1)[0][:MOST_SHOWN]
        expected = f"valid JSON ({error.msg[:1].lower()}{error.msg[1:]})"
        raise BadInput(
            path, position, repr(rest_of_line) if rest_of_line else "the end", expected
        ) from error
    except (RecursionError, ValueError) as error:
        raise _hostile(path, error) from error


class KeyTwice(ValueError):
    """A JSON object has two values with one key."""

    def __init__(self, key: str, values: list[Any]) -> None:
        self.key = key
        self.description = "this key with " + " and with ".join(map(_quote, values[:2]))
        super().__init__(f"{key}: {self.description}")


def decode_json_text(text: str | bytes) -> Any:
    """Return the value of a JSON text; raises `KeyTwice` for a repeated key.

    `json.loads` would silently take the last value; it raises its errors here too.
    """
    return json.loads(text, object_pairs_hook=_of_keys_once)


def _of_keys_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        key = Counter(key for key, _ in pairs).most_common(1)[0][0]
        raise KeyTwice(key, [value for name, value in pairs if name == key])
    return table


def validate(
    path: str | Path, data: object, model: type[Content], first: Mapping[str, int] | None = None
) -> Content:
    """Check parsed *data*; faults become a `BadInput` naming its key, with (a hundred) `more`.

    *first*: by list, the number from 0, in the file, of the first element in *data*, which has only
    a part of that list.
    """
    try:
        _refuse_invisible(path, data)
        # As JSON: there, strict refuses "5" as a number, but accepts a list for a tuple.
        text = json.dumps(data, default=str)
        return model.model_validate_json(text, strict=True)
    except RecursionError as error:
        raise _hostile(path, error) from error
    except ValidationError as error:
        faults = [
            BadInput(
                path,
                _key(_location(fault), data, first) or "the file",
                *_found_expected(fault, model),
            )
            for fault in error.errors(include_url=False)[:MOST_FAULTS]
            if fault["type"] != "default_factory_not_called"  # due to a fault that is reported
        ]
        raise join_faults(faults) from error


def _text(path: str | Path, content: bytes) -> str:
    """Decode a text that is not too large to parse; raises `BadInput`."""
    values = content.count(b",") + content.count(b"=")
    if values > MOST_VALUES:
        raise BadInput(path, "the file", f"{values} values", f"{MOST_VALUES} at most")
    for mark, name in MARKS.items():
        if content.startswith(mark):
            mark_in_words = f"a byte order mark of {name} before the text"
            raise BadInput(
                path, "byte 0", mark_in_words, "UTF-8 without one: save it so in the editor"
            )
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise BadInput(path, f"byte {error.start}", "not UTF-8", "UTF-8 text") from error


def _hostile(path: str | Path, error: RecursionError | ValueError) -> BadInput:
    """Return the error of a text at which parsers fail: deep nesting, or very long numbers."""
    if isinstance(error, RecursionError):
        return BadInput(path, "the file", "brackets in brackets without end", "a few levels")
    return BadInput(path, "the file", "a number of thousands of digits", "numbers of a few")


def _location(fault: Any) -> tuple[int | str, ...]:
    location: tuple[int | str, ...] = fault["loc"]
    match fault["type"]:
        case "armd_key":
            return (*location, fault["ctx"]["key"])
        case "union_tag_invalid" | "union_tag_not_found":
            return (*location, fault["ctx"]["discriminator"].strip("'"))
    return location


def _key(
    location: tuple[int | str, ...], data: object, first: Mapping[str, int] | None = None
) -> str:
    """Write a location as a key: `("joint", 2, "a_mm")` as `joint[3].a_mm`, counted from one.

    A part that the data do not hold is the tag of a union, unless it is the last: then it is a
    missing key.
    """
    key = ""
    for i, part in enumerate(location):
        if isinstance(data, dict) and part not in data and i < len(location) - 1:
            continue
        if isinstance(data, dict):
            data = data.get(part)
        elif isinstance(data, list) and isinstance(part, int) and part < len(data):
            data = data[part]
        if isinstance(part, int):
            part += 1 + (first or {}).get(key, 0)
            key += f"[{part}]"
        else:
            key += f".{part}" if key else part
    return key


def _quote(value: object) -> str:
    """Return a value as in its file; text in quotation marks."""
    match value:
        case None:
            text = "nothing"
        case bool():
            text = str(value).lower()
        case dict():
            text = f"a table with {format_names(map(str, value))}" if value else "an empty table"
        case list():
            text = f"[{', '.join(map(_quote, value[: MOST_SHOWN // 2]))}]"
        case _:
            text = repr(value)
    return text if len(text) <= MOST_SHOWN else text[: MOST_SHOWN - 3] + "..."


def _refuse_invisible(path: str | Path, data: object) -> None:
    """Raise `BadInput` for text with control characters or marks of writing direction.

    No name needs any, and names go into messages and reports.
    """
    for key, value in _texts(data, ""):
        for text in (key, value):
            if hidden := escape_invisible(text):
                expected = "text without control characters and marks that turn the writing"
                raise BadInput(
                    path, to_printable(key) or "the file", f"the character {hidden}", expected
                )


def _texts(data: object, key: str) -> Iterator[tuple[str, str]]:
    """Yield each text of parsed *data*, and every key, with its location."""
    if isinstance(data, str):
        yield key, data
    elif isinstance(data, dict):
        for name, value in data.items():
            below = f"{key}.{name}" if key else str(name)
            yield below, ""
            yield from _texts(value, below)
    elif isinstance(data, list):
        for i, value in enumerate(data, 1):
            yield from _texts(value, f"{key}[{i}]")


def _schema(quoted: str) -> str:
    return f"{FILES[quoted]} ({quoted})" if quoted in FILES else quoted


def _found_expected(fault: Any, model: type[BaseModel]) -> tuple[str, str]:
    match fault["type"]:
        case "armd_key":
            return fault["ctx"]["found"], fault["ctx"]["expected"]
        case "missing":
            *table, key = fault["loc"]
            present_keys = set(fault["input"]) if isinstance(fault["input"], dict) else set()
            strange = sorted(present_keys.difference(list_keys_at(model, table)))
            like = find_nearest(str(key), strange)
            return (f"{like!r} instead" if like else "nothing"), "this key"
        case "extra_forbidden":
            *table, key = fault["loc"]
            known_keys = list_keys_at(model, table)
            return (
                "an unknown key",
                f"one of the documented keys{suggest_names(str(key), known_keys)}",
            )
        case "union_tag_not_found":
            return "nothing", "this key"
        case "union_tag_invalid":
            tag = fault["input"][fault["ctx"]["discriminator"].strip("'")]
            return repr(tag), f"one of {fault['ctx']['expected_tags']}"
    quoted_input = _quote(fault["input"])
    match fault["type"]:
        case "value_error" if isinstance(fault["input"], dict):
            return "values that do not fit together", fault["msg"].removeprefix("Value error, ")
        case "model_type" | "dict_type" | "model_attributes_type":
            return quoted_input, "a table"
        case "too_short" | "too_long" if isinstance(fault["input"], list):
            side_of_bound = "at least" if fault["type"] == "too_short" else "at most"
            bound = fault["ctx"]["min_length" if fault["type"] == "too_short" else "max_length"]
            return f"{len(fault['input'])} entries", f"{side_of_bound} {bound}"
        case "literal_error" if fault["loc"] == ("schema",):
            expected = fault["ctx"]["expected"]
            return _schema(quoted_input), _schema(expected)
    message = fault["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    return quoted_input, message
