"""Decision records are short and in one form, the index lists all of them, and no reference in the
repository is to a record that does not exist."""

from __future__ import annotations

import re
import shlex
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DECISIONS = ROOT / "docs" / "decisions"
HEADINGS = ["Context", "Decision", "Rejected", "Reopen"]
MOST_WORDS = 200
#: No imperative begins so.
NO_VERBS = {"a", "an", "the", "what", "how", "why", "when", "where", "no", "not", "of", "on", "in"}
INDEX_ROW = re.compile(r"^\| (\d+) \| \[(.+?)\]\((.+?)\) \| .+ \|$", re.MULTILINE)
#: `decision 12`, `decisions 12 and 13`, `decisions [1](…), [2](…) and [3](…)`.
MENTION = re.compile(
    r"\bdecisions?\s+((?:\[?\d+\b(?:\]\([^)]*\))?(?:\s*(?:,|and|to|or)\s*(?=\[?\d))*)+)",
    re.IGNORECASE,
)
PATH = re.compile(r"\bdecisions/(\d{4})(-[\w-]+\.md)?")
COMMANDS = re.compile(r"```sh\n(.*?)```", re.DOTALL)
SEARCHED = ("armd", "compensation", "daemon", "deploy", "docs", "drivers", "simulator", "tests")
TEXT = {".cff", ".conf", ".cpp", ".h", ".js", ".md", ".py", ".service", ".sh", ".toml", ".yml"}


def record_faults(path: Path, expected: int) -> Iterator[str]:
    """What is wrong with one record, whose number is to be *expected*."""
    where = f"docs/decisions/{path.name}"
    name = re.fullmatch(r"(\d{4})-([a-z0-9]+(?:-[a-z0-9]+)*)\.md", path.name)
    if not name:
        yield f"{where}: expected a name like {expected:04d}-imperative-title.md"
        return
    if int(name[1]) != expected:
        yield f"{where}: found number {int(name[1])}, expected the next one, {expected}: rename it"
    if name[2].split("-")[0] in NO_VERBS:
        yield f"{where}: found a title with {name[2].split('-')[0]!r} first, expected a verb"
    text = path.read_text(encoding="utf-8")
    first = text.splitlines()[0]
    if not re.fullmatch(rf"# {int(name[1])}\. \S.*[^.]", first):
        yield f"{where}: line 1: found {first[:60]!r}, expected '# {int(name[1])}. Title'"
    headings = re.findall(r"^## (.*)$", text, re.MULTILINE)
    if headings != HEADINGS:
        yield f"{where}: found headings {headings}, expected {HEADINGS} (each after '## ')"
    elif not all(part.strip() for part in re.split(r"^## .*$", text, flags=re.MULTILINE)[1:]):
        yield f"{where}: found a heading without a text below it"
    if len(text.split()) > MOST_WORDS:
        yield f"{where}: found {len(text.split())} words, expected at most {MOST_WORDS}"


def folder_faults(folder: Path) -> Iterator[str]:
    """What is wrong with the records of a folder and with their index."""
    records = sorted(path for path in folder.iterdir() if path.name != "README.md")
    for number, path in enumerate(records, start=1):
        yield from record_faults(path, number)
    listed = [tuple(row) for row in INDEX_ROW.findall((folder / "README.md").read_text("utf-8"))]
    for number, path in enumerate(records, start=1):
        title = path.read_text(encoding="utf-8").splitlines()[0].partition(". ")[2]
        if (str(number), title, path.name) not in listed:
            row = f"| {number} | [{title}]({path.name}) |"
            yield f"docs/decisions/README.md: expected a row {row!r}"
    for number, title, file in listed:
        if not (folder / file).is_file():
            yield f"docs/decisions/README.md: found {number} ({title}), expected a file {file}"


def reference_faults(where: str, text: str, names: set[str]) -> Iterator[str]:
    """References in a text to records that are not among the file *names*."""
    numbers = {int(name[:4]) for name in names}
    for found in PATH.finditer(text):
        if int(found[1]) not in numbers or (found[2] and found[1] + found[2] not in names):
            yield f"{where}: found {found[0]}, expected a record of docs/decisions/README.md"
    for found in MENTION.finditer(text):
        for number in re.findall(r"\d+", re.sub(r"\]\([^)]*\)", "", found[1])):
            if int(number) not in numbers:
                yield f"{where}: found decision {number}, expected one of 1 to {max(numbers)}"


def texts() -> Iterator[tuple[str, str]]:
    """The name and content of each file that people write."""
    files = [path for path in ROOT.iterdir() if path.is_file()]
    for folder in SEARCHED:
        files += (ROOT / folder).rglob("*")
    for path in files:
        wanted = path.suffix in TEXT or path.name == "Makefile"
        if wanted and path.is_file() and path != Path(__file__):
            text = path.read_text(encoding="utf-8")
            if path == DECISIONS / "README.md":  # its commands name records of the git history
                text = COMMANDS.sub("", text)
            yield str(path.relative_to(ROOT)), text


def test_records_are_short_and_the_index_is_complete() -> None:
    assert list(folder_faults(DECISIONS)) == []


def test_references_are_to_records_that_exist() -> None:
    names = {path.name for path in DECISIONS.glob("0*.md")}
    faults = [fault for name, text in texts() for fault in reference_faults(name, text, names)]
    assert faults == []


def test_the_check_says_what_is_wrong(tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("| 1 | [Gone](0001-gone.md) | x | 2 |\n")
    (tmp_path / "0213-what-stays.md").write_text("# What stays\n\n" + "word " * 201)
    assert list(folder_faults(tmp_path)) == [
        "docs/decisions/0213-what-stays.md: found number 213, expected the next one, 1: rename it",
        "docs/decisions/0213-what-stays.md: found a title with 'what' first, expected a verb",
        "docs/decisions/0213-what-stays.md: line 1: found '# What stays', expected '# 213. Title'",
        "docs/decisions/0213-what-stays.md: found headings [], expected"
        " ['Context', 'Decision', 'Rejected', 'Reopen'] (each after '## ')",
        "docs/decisions/0213-what-stays.md: found 204 words, expected at most 200",
        "docs/decisions/README.md: expected a row '| 1 | [](0213-what-stays.md) |'",
        "docs/decisions/README.md: found 1 (Gone), expected a file 0001-gone.md",
    ]


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("see decision 9 and docs/decisions/0002-b.md", ["decision 9"]),
        ("(decisions 1, 7 and [8](decisions/0002-b.md))", ["decision 7", "decision 8"]),
        ("docs/decisions/0002, decisions/0002-c.md", ["decisions/0002-c.md"]),
        ("the decision rule of 1998; decision 2", []),
    ],
)
def test_the_check_finds_references(text: str, wrong: list[str]) -> None:
    faults = list(reference_faults("a.md", text, {"0001-a.md", "0002-b.md"}))
    assert [fault.split("found ")[1].split(", expected")[0] for fault in faults] == wrong


def test_the_commands_for_older_records_find_them() -> None:
    text = (DECISIONS / "README.md").read_text(encoding="utf-8")
    block = COMMANDS.search(text)
    assert block
    commands = [shlex.split(line, comments=True) for line in block[1].splitlines()]
    assert len(commands) == 4
    known = subprocess.run(
        ["git", "cat-file", "-e", "62b723ea"], cwd=ROOT, capture_output=True, check=False
    )
    if known.returncode != 0:
        pytest.skip("needs the git history")
    for command in commands:
        run = subprocess.run(command, cwd=ROOT, capture_output=True, check=False)
        assert run.returncode == 0 and run.stdout, command
