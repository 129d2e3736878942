"""Imports within a room run downwards, and not far: what stands in a file is read in few others."""

import functools

import grimp
import pytest

#: Modules one after another, each imported by the one before, within a folder.
LONGEST = 8
#: Tables of numbers, in which nothing is done: whoever needs one reads it, at any height.
TABLES = {"armd.compensation.diagnose.constants"}


@pytest.fixture(scope="module")
def imports() -> dict[str, set[str]]:
    graph = grimp.build_graph("armd")
    return {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}


def longest(imports: dict[str, set[str]], among: set[str]) -> list[str]:
    """The longest chain of modules *among* these; none leads back to itself."""

    @functools.cache
    def below(module: str) -> tuple[str, ...]:
        chains = (below(other) for other in imports[module] & among if other != module)
        return (module, *max(chains, key=len, default=()))

    return list(max(map(below, sorted(among)), key=len, default=()))


def test_no_chain_within_a_folder_is_long(imports: dict[str, set[str]]) -> None:
    folders: dict[str, set[str]] = {}
    for module in imports:
        folders.setdefault(module.rpartition(".")[0], set()).add(module)
    assert len(folders["armd.compensation.estimate"]) > 10
    too_long = {
        folder: chain
        for folder, modules in folders.items()
        if len(chain := longest(imports, modules)) > LONGEST
    }
    assert not too_long


@pytest.mark.parametrize(
    "room",
    [
        "compensation.diagnose",
        "compensation.effects",
        "compensation.identify",
        "compensation.interim",
        "daemon",
        "drivers",
        "simulator",
    ],
)
def test_a_room_with_its_rooms_is_not_deep(imports: dict[str, set[str]], room: str) -> None:
    within = {module for module in imports if module.startswith(f"armd.{room}.")} - TABLES
    assert len(within) > 10
    chain = longest(imports, within)
    assert len(chain) <= LONGEST, " → ".join(chain)
