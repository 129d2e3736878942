"""The chain of a history's lines, read while another program adds to it."""

from __future__ import annotations

from pathlib import Path

import pytest

from armd.compensation.interim.checks import chain
from armd.compensation.interim.checks.chain import read_chain
from armd.errors import BadInput
from armd.files.inputs import read_input
from support.interim_history import write_history


def test_lines_and_their_hashes(tmp_path: Path) -> None:
    assert read_chain(tmp_path).lines == ()
    hashes = write_history(tmp_path, ["a", "b", "c"])
    found = read_chain(tmp_path)
    assert [line.name for line in found.lines] == ["a", "b", "c"]
    assert list(found.hashes) == hashes


@pytest.mark.parametrize("before", [[], ["a"], ["a", "b"]])
def test_a_check_that_is_added_meanwhile_is_no_damage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, before: list[str]
) -> None:
    """Between any two files that are read."""
    write_history(tmp_path, before)
    for meanwhile in (1, 2):
        reads = 0

        def read(path: str | Path) -> bytes:
            nonlocal reads
            reads += 1
            data = read_input(path)
            if reads == meanwhile:  # noqa: B023
                write_history(tmp_path, [*before, "more"])
            return data

        write_history(tmp_path, before)
        with monkeypatch.context() as patched:
            patched.setattr(chain, "read_input", read)
            assert len(read_chain(tmp_path).lines) in (len(before), len(before) + 1)
            assert reads == 2


@pytest.mark.parametrize("how", ["fewer", "another last", "no head", "torn", "gone"])
def test_a_chain_that_is_broken_or_cut_short_is_told(tmp_path: Path, how: str) -> None:
    write_history(tmp_path, ["a", "b", "c"])
    history, head = tmp_path / "history.jsonl", tmp_path / "head.json"
    lines = history.read_text().splitlines(keepends=True)
    match how:
        case "fewer":
            history.write_text("".join(lines[:2]))
        case "another last":
            history.write_text("".join([*lines[:2], lines[2].replace('"c"', '"d"')]))
        case "no head":
            head.unlink()
        case "torn":
            history.write_text("".join(lines)[:-9])
        case "gone":
            history.unlink()
    with pytest.raises(BadInput):
        read_chain(tmp_path)
