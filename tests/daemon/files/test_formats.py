"""`armd schema`, and the pages on formats: every key, its default, an example that holds."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from armd.compensation.data.sessions.columns import list_number_columns
from armd.compensation.model.arm import Arm
from armd.daemon.cli import main
from armd.daemon.commands.setup.schema import FORMATS, make_json_schema
from support.pages import page_path

SECTIONS = {
    "arm": "arm.toml", "session": "session.toml", "mpe": "mpe.toml",
    "about": "about.toml", "calibration": "calibration.json",
}  # fmt: skip


def keys(table: dict[str, Any], root: dict[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Every key, dotted, with its default as the page has it."""
    for key, value in table.get("properties", {}).items():
        name = above + key
        if key in table.get("required", []):
            yield name, "required"
        else:
            default = value.get("default", [])  # a factory's, which is a list everywhere
            yield name, "none" if default is None else default
        parts = [value, value.get("items", {}), value.get("additionalProperties", {})]
        for part in parts + value.get("anyOf", []):
            if isinstance(part, dict) and "$ref" in part:
                below = root["$defs"][part["$ref"].removeprefix("#/$defs/")]
                yield from keys(below, root, f"{name}.")


def rows(title: str) -> dict[str, dict[str, str]]:
    """The row of each key, its cells by the table's head."""
    text = page_path("formats").read_text(encoding="utf-8")
    section = text.split(f"\n## {title}\n")[1].split("\n## ")[0]
    (head,) = re.findall(r"^\| Key \|(.*)\|$", section, re.MULTILINE)
    names = [cell.strip() for cell in head.split("|")]
    cells = re.findall(r"^\| `([^`]+)` \|(.*)\|$", section, re.MULTILINE)
    return {
        key: dict(zip(names, (cell.strip() for cell in rest.split("|")), strict=True))
        for key, rest in cells
    }


@pytest.mark.parametrize("name", SECTIONS)
def test_the_page_has_every_key_and_its_default(name: str) -> None:
    schema = make_json_schema(name)
    expected = dict(keys(schema, schema))
    shown = rows(SECTIONS[name])
    assert list(shown) == list(expected)
    for key, default in expected.items():
        of_page = shown[key]["Default"]
        if isinstance(default, dict) and default:  # a table of defaults, each told in its own row
            assert of_page == "", key
        elif default in ("required", "none"):
            assert of_page == default, key
        else:
            assert json.loads(of_page) == default, key


@pytest.mark.parametrize("name", ["arm", "session"])
def test_the_examples_are_accepted(name: str) -> None:
    """Put together, the examples of a page are a file that holds."""
    data: dict[str, Any] = {}
    for key, cells in rows(SECTIONS[name]).items():
        *above, last = key.split(".")
        table: Any = data
        for part in above:
            table = table[part][-1] if isinstance(table[part], list) else table[part]
        example = cells["Example"].split("` or `")[0].strip("`")
        if example.startswith("[["):
            table[last] = [{}]
        elif example == f"[{last}]":
            table[last] = {}
        else:
            table[last] = tomllib.loads(f"it = {example}")["it"]
    if name == "arm":
        data["joint"] *= 3
    if name == "session":
        data["artefact"]["target"] += [{"name": "S1"}, {"name": "S2"}]
    FORMATS[name][0].model_validate_json(json.dumps(data, default=str), strict=True)


def test_the_example_of_limits_is_accepted_and_has_every_key() -> None:
    text = page_path("verify").read_text(encoding="utf-8")
    (example,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    data = tomllib.loads(example)
    FORMATS["mpe"][0].model_validate_json(json.dumps(data), strict=True)
    schema = make_json_schema("mpe")
    dotted = {f"{table}.{key}" for table in ("mpe", "uncertainty") for key in data[table]}
    assert {*data, *dotted} == {key for key, _ in keys(schema, schema)}


def test_the_daemons_page_has_every_key() -> None:
    schema = make_json_schema("daemon")
    text = page_path("configure").read_text(encoding="utf-8")
    for key, _ in keys(schema, schema):
        assert re.search(rf"[`\[.]{key.rsplit('.', 1)[-1]}\b", text) or key in text, key


def test_the_page_has_every_column() -> None:
    arm = Arm.model_validate(
        {"schema": "armd.arm/1", "serial_number": "A", "joint": [{}] * 3,
         "temperature_sensor": [{"name": "t1"}]}
    )  # fmt: skip
    text = page_path("formats").read_text(encoding="utf-8")
    section = text.split("\n## readings.csv\n")[1].split("\n## ")[0]
    for column in list_number_columns(arm):
        shown = {"t1": "a sensor's name"}
        joint = re.fullmatch(r"([qw])\d", column)
        cell = f"`{joint[1]}1`" if joint else shown.get(column, f"`{column}`")
        assert cell in section, column


@pytest.mark.parametrize("name", FORMATS)
def test_the_command_writes_it(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["schema", name]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["additionalProperties"] is False
    out = tmp_path / "s.json"
    for _ in range(2):
        assert main(["schema", name, "-o", str(out)]) == 0
    assert json.loads(out.read_text()) == printed
    out.write_text("mine")
    assert main(["schema", name, "-o", str(out)]) == 2
