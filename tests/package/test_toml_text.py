"""What is written as TOML is what any reader of TOML reads."""

import datetime
import math
import tomllib
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armd.files.toml_text import format_toml

#: Whatever may need an escape, and some letters.
TEXT = st.text(st.sampled_from("\x00\t\n\r\x1f\x7f\"'\\ .=[]#azÅµ-_0\u2028𝛼"), max_size=6)
NUMBERS = st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False)
VALUES = TEXT | NUMBERS | st.booleans() | st.lists(TEXT | NUMBERS, max_size=3)
TABLES = st.dictionaries(TEXT, VALUES, max_size=3)
WITHIN = st.dictionaries(
    TEXT, VALUES | TABLES | st.lists(TABLES, min_size=1, max_size=2), max_size=3
)


@settings(max_examples=100)
@given(
    st.dictionaries(TEXT, VALUES | WITHIN | st.lists(TABLES, min_size=1, max_size=2), max_size=3)
)
def test_any_content_comes_back(content: dict[str, Any]) -> None:
    assert tomllib.loads(format_toml(content)) == content


def test_it_reads_as_a_person_would_write_it() -> None:
    content = {
        "schema": "armd.session/1",
        "started": datetime.datetime(2026, 3, 1, 9, tzinfo=datetime.UTC),
        "artefact": {
            "name": 'ball "beam"',
            "target": [{"name": "B1", "position_mm": np.array([0.1, 2.0, -3e-7])}],
        },
        "joint": [{"d_mm": 300.0, "temperature": {"t1": 0.5, "t 2": 0.5}}],
    }
    text = """schema = "armd.session/1"
started = 2026-03-01T09:00:00+00:00

[artefact]
name = "ball \\\\"beam\\\\""

[[artefact.target]]
name = "B1"
position_mm = [0.1, 2.0, -3e-07]

[[joint]]
d_mm = 300.0
temperature = { t1 = 0.5, "t 2" = 0.5 }
"""
    assert format_toml(content) == text.replace("\\\\", "\\")


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan])
def test_what_is_no_number_is_told_as_such(value: float) -> None:
    (found,) = tomllib.loads(format_toml({"x": value})).values()
    assert found == value or (math.isnan(found) and math.isnan(value))
