"""Each docstring begins with a whole, short sentence (CONTRIBUTING.md, Words)."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("armd", "drivers", "compensation", "daemon", "simulator")
MOST_WORDS = 20  # of the first sentence; shapes and units in parentheses are not counted
#: What begins a fragment: a sentence without a subject or without a verb.
FRAGMENTS = frozenset(
    """
    what whatever whose of by as where with without how that which from at in on to for beside
    between after before among until so such under over into through against likewise
    """.split()  # noqa: SIM905
)
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def list_docstrings(source: str) -> Iterator[tuple[str, str]]:
    """Yield the name of each function, class or module, and the first sentence of its docstring."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, DOCUMENTED) and (docstring := ast.get_docstring(node)):
            paragraph = re.sub(r"\s+", " ", docstring.split("\n\n")[0])
            yield getattr(node, "name", "module"), re.split(r"(?<=[.!?])\s", paragraph)[0]


def find_fault(sentence: str) -> str | None:
    """Say what is wrong with a docstring's first sentence, if anything is."""
    if sentence.split()[0].lower().strip(",:") in FRAGMENTS or sentence.startswith("The same "):
        return f"begins with a fragment: {sentence}"
    text, before = re.sub(r"`[^`]*`", "x", sentence), ""
    while text != before:
        text, before = re.sub(r"\([^()]*\)", "", text), text
    words = len([word for word in text.split() if re.search(r"\w", word)])
    return f"has {words} words: {sentence}" if words > MOST_WORDS else None


@pytest.mark.parametrize("package", PACKAGES)
def test_docstrings_begin_with_a_short_sentence(package: str) -> None:
    faults = [
        f"{path.relative_to(ROOT)}: {name} {fault}"
        for path in sorted((ROOT / package).rglob("*.py"))  # which follows no link
        for name, sentence in list_docstrings(path.read_text(encoding="utf-8"))
        if (fault := find_fault(sentence))
    ]
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize(
    ("sentence", "fault"),
    [
        ("What is left of a curve.", "begins with a fragment: What is left of a curve."),
        ("The same of all rests.", "begins with a fragment: The same of all rests."),
        ("Return the gain (n, 3) in µm of each finding.", None),
        ("Fit " + "words " * 19 + "(one, two) `a b c`.", "has 21 words: "),
    ],
)
def test_a_fragment_and_a_long_sentence_are_found(sentence: str, fault: str | None) -> None:
    assert (find_fault(sentence) or "").startswith(fault or "") and bool(fault) == bool(
        find_fault(sentence)
    )
