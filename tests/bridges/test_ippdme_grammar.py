"""The I++ grammar by property, in both directions: what may be written is read as it was meant,
what we write is of the grammar by a reading of its own, and nothing else gets through."""

from __future__ import annotations

import re
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armd.daemon.bridges.ippdme.grammar import (
    Command,
    Property,
    SyntaxFault,
    Text,
    Word,
    format_decimal,
    format_quoted,
    parse,
    parse_number,
)

BASIC = st.from_regex(r"[A-Za-z][A-Za-z0-9]{0,8}", fullmatch=True)
NAME = st.lists(BASIC, min_size=1, max_size=3).map(".".join)
STRING = st.text(
    st.characters(min_codepoint=32, max_codepoint=126, exclude_characters='"'), min_size=1
)
NUMBER = st.from_regex(
    r"[+-]?([0-9]{1,6}(\.[0-9]{0,5})?|\.[0-9]{1,6})([Ee][+-]?[0-9]{1,2})?", fullmatch=True
)
TAG = st.integers(1, 99999).map("{:05d}".format)
SPACES = st.integers(0, 3).map(lambda n: " " * n)


@st.composite
def argument(draw: st.DrawFn, nested: bool = True) -> tuple[str, Any]:
    """As written, and as meant."""
    kind = draw(st.sampled_from(["number", "string", "word", "property"][: 4 if nested else 3]))
    if kind == "number":
        text = draw(NUMBER)
        return text, float(text)
    if kind == "string":
        value = draw(STRING)
        return f'"{value}"', Text(value)
    if kind == "word":
        value = draw(BASIC)
        return value, Word(value)
    name = draw(NAME)
    inner = draw(st.lists(argument(nested=False), max_size=3))
    return name + draw(parenthesised(inner)), Property(name, tuple(meant for _, meant in inner))


@st.composite
def parenthesised(draw: st.DrawFn, written: list[tuple[str, Any]]) -> str:
    def comma() -> str:
        return draw(SPACES) + "," + draw(SPACES)

    inside = ""
    for i, (text, _) in enumerate(written):
        inside += (comma() if i else "") + text
    return draw(SPACES) + "(" + draw(SPACES) + inside + draw(SPACES) + ")"


@given(st.data())
def test_whatever_the_grammar_allows_is_read_as_meant(data: st.DataObject) -> None:
    tag, method = data.draw(TAG), data.draw(BASIC)
    args = data.draw(st.lists(argument(), max_size=4))
    line = f"{tag} {method}{data.draw(parenthesised(args))}"
    assert parse(line) == Command(tag, method, tuple(meant for _, meant in args))


@given(st.text(st.characters(max_codepoint=255), max_size=60))
def test_anything_else_is_a_fault_of_the_table_and_never_an_exception(line: str) -> None:
    try:
        command = parse(line)
    except SyntaxFault as fault:
        assert fault.number in (1, 2, 7, 8, 502)
        assert re.fullmatch(r"[ !#-~]+", fault.method)
    else:
        assert re.fullmatch(r"\d{5}|E\d{4}", command.tag)


@given(TAG, st.data())
def test_a_damaged_line_is_not_read_as_another(tag: str, data: st.DataObject) -> None:
    whole = f'{tag} PtMeas(X(1.5), IJK(0, 0, 1), "a")'
    cut = whole[: data.draw(st.integers(0, len(whole) - 1))]
    with pytest.raises(SyntaxFault):
        parse(cut)
    with pytest.raises(SyntaxFault):
        parse(whole + data.draw(st.sampled_from([" ", ")", "x", "\r", "\x00", "é"])))


@pytest.mark.parametrize(
    ("line", "expected", "tag"),
    [
        ("", 1, None),
        ("1 StartSession()", 1, None),
        ("00000 StartSession()", 1, None),
        ("E0000 AbortE()", 1, None),
        ("e0001 AbortE()", 1, None),
        ("00001StartSession()", 2, "00001"),
        ("00001", 2, "00001"),
        ("00001 StartSession()\n", 7, "00001"),
        ("00001 Start\tSession()", 7, "00001"),
        ("\xff0001 StartSession()", 7, None),
        ("00001 1()", 8, "00001"),
        ("00001  Get()", 8, "00001"),
        ("00001 StartSession", 502, "00001"),
        ("00001 StartSession() ", 502, "00001"),
        ("00001 Get(X()", 502, "00001"),
        ("00001 Get(X(),)", 502, "00001"),
        ('00001 ChangeTool("")', 502, "00001"),
        ("00001 Get(X(Y()))", 502, "00001"),
        ("00001 Get(12345678901234567)", 502, "00001"),
    ],
)
def test_faults(line: str, expected: int, tag: str | None) -> None:
    with pytest.raises(SyntaxFault) as raised:
        parse(line)
    assert (raised.value.number, raised.value.tag) == (expected, tag)


#: Of NIST's test suite 3.0, numbersCmdOK.prg: all are numbers of the standard.
NIST_NUMBERS = """
    0 123 +90 -90 12.2 +1.2 -1.2 1234567890123456 1.234567890123456 +1.234567890123456 -0000 0090
    +0090 -0090 +0000.5 +0000.5E7 3.9E2 1.3E02 3.8E002 +6.333E1 -9.333E01 +1.234567890123456E003
    +1.234567890123456E-123 +6.333E+01 +6.382E-01 -6.333E+01 -6.382E-012 3.9e2 .123 123.
"""


def test_numbers_of_the_standard() -> None:
    for text in (*NIST_NUMBERS.split(), "+1.", "-.5", "1.5E-003"):
        assert parse_number(text) == float(text), text
    for text in ("", ".", "1e", "e5", "0x1", "1,5", "nan", "\u0661", "1_0"):
        assert parse_number(text) is None, text
    for text in ("1e400", "-1E999", "1e1234", "1E9999", "1" * 17):  # more than a double holds
        assert parse_number(text) is None, text


@given(st.floats(-1e9, 1e9), st.integers(0, 6))
def test_what_we_write_is_a_number_of_the_standard(value: float, places: int) -> None:
    text = format_decimal(value, places)
    read = parse_number(text)
    assert read is not None
    assert read == pytest.approx(value, abs=0.51 * 10.0**-places)
    assert not re.fullmatch(r"-0(\.0*)?", text)


@given(st.text(max_size=300))
def test_what_we_quote_is_a_string_of_the_standard(text: str) -> None:
    command = parse(f"00001 KeyPress({format_quoted(text)})")
    assert isinstance(command.args[0], Text)


@given(st.floats(-1e300, 1e300))
def test_whatever_is_written_is_a_number_of_the_grammar(value: float) -> None:
    assert parse_number(format_decimal(value, 9)) is not None


def test_deep_nesting_is_a_fault_of_the_grammar() -> None:
    with pytest.raises(SyntaxFault) as raised:
        parse("00001 Get(" + "X(" * 5000 + ")" * 5001)
    assert raised.value.number == 502
