"""Every page of docs/ is reached from the README, its links lead somewhere, the files that it names
exist, and the commands that its blocks show are commands that armd takes."""

from __future__ import annotations

import argparse
import configparser
import os
import re
import shlex
import subprocess
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from armd.compensation.effects.catalogue import CATALOGUE
from armd.daemon.cli import make_parsers
from armd.daemon.commands.groups import COMMANDS
from armd.simulator import sessions
from armd.simulator.options import make_parser as simulated_arm
from support.pages import DOCS

ROOT = Path(__file__).parents[2]
PAGES = ["README.md", *sorted(str(path.relative_to(ROOT)) for path in DOCS.glob("**/*.md"))]
MOST_WORDS = 25_000
MOST_WORDS_OF_A_PARAGRAPH = 120
NAMING = [
    "CONTRIBUTING.md",
    "SECURITY.md",
    *PAGES,
    *sorted(str(path.relative_to(ROOT)) for path in DOCS.glob("**/*.rst")),
    *sorted(str(path.relative_to(ROOT)) for path in DOCS.glob("**/*.ipynb")),
]
FOLDERS = ("armd", "compensation", "daemon", "deploy", "docs", "drivers", "simulator", "tests")
NAMED = re.compile(rf"(?<![\w/.@-])((?:{'|'.join(FOLDERS)})/[\w./-]*\w)(?!\w|-?\*)")
#: What a reader of extend.md is to write: files called so, where their folder is, and one example.
TO_NAME = re.compile(r"[^/]*NAME.*")
EXAMPLE = "compensation/effects/mechanical/viscous_drag.py"
LINK = re.compile(r"\]\((?!https?:)([\w./-]+)(?:#[\w-]*)?\)")


def links(page: str) -> set[str]:
    """Relative to the project."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return {os.path.normpath(Path(page).parent / target) for target in LINK.findall(text)}


@dataclass(frozen=True)
class Block:
    language: str
    """Empty: something to look at, what a program prints or a drawing."""
    text: str


def blocks(page: str) -> list[Block]:
    """Between fences, one after the other."""
    found, language, lines = [], None, list[str]()
    for line in (ROOT / page).read_text(encoding="utf-8").splitlines():
        fence = re.fullmatch(r" *```(\w*)", line)
        if fence and language is None:
            language = fence[1]
        elif fence:
            assert not fence[1], f"{page}: a block of {language} is not closed"
            found.append(Block(str(language), "\n".join(lines) + "\n"))
            language, lines = None, []
        elif language is not None:
            lines.append(line)
    assert language is None
    return found


def simple_commands(text: str) -> Iterator[list[str]]:
    """The words of each command of a shell's lines, its redirections left out."""
    without_files = re.sub(r"<<'?(\w+)'?(.*)\n(?:.*\n)*?\1\n", r"\2\n", text)
    for line in without_files.replace("\\\n", " ").splitlines():
        lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
        lexer.whitespace_split = True
        words: list[str] = []
        to_file = False
        for word in lexer:
            if set(word) <= set("<>&|;()") and not set(word) <= set("<>"):
                yield words
                words = []
            elif not to_file and word not in ("<", ">", ">>"):
                words.append(word)
            to_file = word in ("<", ">", ">>")
        yield words


def shown(page: str) -> list[list[str]]:
    """The calls of armd in the blocks of a page, without what stands before them (sudo)."""
    text = "".join(block.text for block in blocks(page) if block.language == "sh")
    return [words[words.index("armd") :] for words in simple_commands(text) if "armd" in words[:2]]


def test_every_page_is_reached_from_the_readme() -> None:
    reached: set[str] = set()
    waiting = {"README.md"}
    while waiting:
        page = waiting.pop()
        reached.add(page)
        waiting |= {target for target in links(page) if target.endswith(".md")} - reached
    assert set(PAGES) - reached == set()


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page: str) -> None:
    assert [target for target in links(page) if not (ROOT / target).exists()] == []


def missing_paths(text: str) -> list[str]:
    """The files and folders of the project that a text names and that do not exist."""
    named = sorted({TO_NAME.sub("", name) for name in NAMED.findall(text)} - {EXAMPLE})
    return [name for name in named if not (ROOT / name).exists()]


def missing_of_tour(text: str) -> list[str]:
    """The files and folders that a page names by their end, and that are not where it says.

    An item that begins with a folder speaks of that folder, all other text of any.
    """
    missing = []
    for line in text.splitlines():
        item = re.match(r"- `([\w/]+)/`", line)
        folders = [item[1]] if item and (ROOT / item[1]).is_dir() else FOLDERS
        named = re.findall(r"`([\w/]+(?:\.py|/))`", line)
        for name in {TO_NAME.sub("", name) for name in named} - {EXAMPLE}:
            below = any(any((ROOT / folder).rglob(name)) for folder in folders)
            if not below and not (ROOT / name).exists():
                missing.append(name)
    return missing


@pytest.mark.parametrize("page", NAMING)
def test_files_that_a_page_names_exist(page: str) -> None:
    assert missing_paths((ROOT / page).read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("page", ["tour", "extend", "diagnosis-how"])
def test_a_developers_page_names_files_where_they_are(page: str) -> None:
    assert missing_of_tour((DOCS / f"developer/{page}.md").read_text(encoding="utf-8")) == []


def test_missing_files_are_found() -> None:
    text = "`tests/package/`, drivers/gone.py, `daemon/NAME.py`, armd/*/alive, deploy/zenoh-*"
    assert missing_paths(text) == ["drivers/gone.py"]
    tour = (
        "`poll/plan.py`, `gone/plan.py`\n- `drivers/poll/`: `plan.py`, `servos/`, `pipeline.py`\n"
    )
    assert missing_of_tour(tour) == ["gone/plan.py", "pipeline.py"]


def page_words() -> int:
    """Words of docs/ but the decisions, which have a limit each; as `wc -w` counts them."""
    pages = [page for page in PAGES if "docs/decisions/" not in page and page != "README.md"]
    return sum(len((ROOT / page).read_text(encoding="utf-8").split()) for page in pages)


def long_paragraphs(text: str) -> list[str]:
    """The beginnings of those over the limit; blocks, tables and lists are no paragraphs."""
    prose = re.sub(r"^ *```.*?^ *```$", "", text, flags=re.DOTALL | re.MULTILINE)
    paragraphs = [part.split() for part in re.split(r"\n\s*\n", prose)]
    return [
        " ".join(words[:8])
        for words in paragraphs
        if len(words) > MOST_WORDS_OF_A_PARAGRAPH and not re.match(r"[|*-]$|\d+\.$", words[0])
    ]


def test_the_pages_are_short() -> None:
    assert page_words() <= MOST_WORDS, "docs/: say each thing once, and link to it"


@pytest.mark.parametrize("page", PAGES)
def test_no_paragraph_is_long(page: str) -> None:
    assert long_paragraphs((ROOT / page).read_text(encoding="utf-8")) == []


def test_long_paragraphs_are_found() -> None:
    long = "many words " * 61
    beside = f"- {long}\n\n| {long} |\n\n1. {long}\n\n```\n{long}\n```\n\nfew words\n"
    assert long_paragraphs(beside) == []
    assert long_paragraphs(f"few words\n\n{long}\n\n{beside}") == ["many words " * 3 + "many words"]


def test_the_page_of_causes_says_what_the_catalogue_says() -> None:
    text = (ROOT / "docs/reference/causes.md").read_text(encoding="utf-8")
    rows = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| `")]
    told = [
        [f"`{effect.cause}`", effect.reason, effect.confounded_with, effect.experiment]
        for effect in CATALOGUE.values()
        if effect.cause != "unknown"
    ]
    assert rows == told


@pytest.fixture(scope="module")
def parser() -> argparse.ArgumentParser:
    return make_parsers(COMMANDS.keys() - {"simulate"})[0]


@pytest.mark.parametrize("page", [page for page in PAGES if shown(page)])
def test_the_commands_shown_are_taken(
    page: str, parser: argparse.ArgumentParser, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in shown(page):
        try:
            if words[1] != "simulate":
                parser.parse_args(words[1:])
            elif "--session" in words:
                command = argparse.ArgumentParser()
                sessions.add_arguments(command)
                command.parse_args(words[2:])
            else:
                simulated_arm().parse_args(words[2:])
        except SystemExit as ended:
            if ended.code == 0:  # --help
                continue
            pytest.fail(f"{page}: {shlex.join(words)}: {capsys.readouterr().err}")


#: As a line that somebody could type begins; what armd prints begins with `armd:`.
TYPED = re.compile(r"(\$ )?(sudo |armd [a-z]|make |pip |python3? |ip |cd |git )")


@pytest.mark.parametrize("page", PAGES)
def test_every_block_is_what_it_says(page: str) -> None:
    """A shell's can be typed and has no placeholder, a file's is one, and what has no language is
    no command."""
    for block in blocks(page):
        match block.language:
            case "":
                assert [line for line in block.text.splitlines() if TYPED.match(line)] == []
            case "sh":
                done = subprocess.run(["bash", "-n"], input=block.text, text=True, check=False)
                assert done.returncode == 0, block.text
                placeholders = re.findall(r"\[--|…|<[a-z]+>|\b[A-Z]+\.(?:toml|json)\b", block.text)
                assert placeholders == [], block.text
            case "toml":
                tomllib.loads(block.text)
            case "python":
                compile(block.text, page, "exec")
            case "ini":
                configparser.ConfigParser(strict=False).read_string(block.text)
            case other:
                assert other == "diff", f"{page}: nobody checks a block of {other}"


def test_words_of_commands_are_found() -> None:
    text = (
        "sudo armd run a.toml && armd status | tee 'b c' # x\n"
        "for i in 1 2; do armd a \\\n -b 'c;d' > e; done\n"
        "cat > f <<'END'\narmd is not called here, it's text\nEND\narmd man\n"
    )
    assert [words for words in simple_commands(text) if "armd" in words] == [
        ["sudo", "armd", "run", "a.toml"], ["armd", "status"],
        ["do", "armd", "a", "-b", "c;d"], ["armd", "man"],
    ]  # fmt: skip
