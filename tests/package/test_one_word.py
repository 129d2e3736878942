"""One word for one thing: a name of a type stands in one place, whatever room it is in."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
ROOMS = ("armd", "drivers", "compensation", "daemon", "simulator")

#: The same thing seen by the simulator, which makes it, and by what finds it out; neither may
#: import the other.
BOTH_SIDES = {"Artefact", "Climate", "Effect", "Length", "Noise", "Timer"}
#: `armd.Arm` is what a subscriber connects to, the other one what arm.toml says. The others are
#: what `armd` gives by that name, around the same thing within.
PUBLIC = {"Arm", "Calibration", "Corrector", "Diagnosis", "Model", "Session"}
#: Sections that two files call alike: `[tip]` of arm.toml, `[tips.NAME]` of armd.toml.
SECTIONS = {"Tip"}


def types(path: Path) -> Iterator[str]:
    """Names of the file's classes, wherever they stand, and of its aliases of types; a type
    variable is none."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    yield from (node.name for node in ast.walk(tree) if isinstance(node, ast.ClassDef))
    for node in tree.body:
        target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
        if isinstance(target, ast.Name) and re.fullmatch(r"_*[A-Z]\w*[a-z]\w*", target.id):
            assert isinstance(node, ast.Assign | ast.AnnAssign)
            if node.value is not None and "TypeVar(" not in ast.unparse(node.value):
                yield target.id


def test_no_type_shares_its_name() -> None:
    where: dict[str, list[str]] = {}
    for room in ROOMS:
        for path in (ROOT / room).rglob("*.py"):
            for name in types(path):
                where.setdefault(name, []).append(str(path.relative_to(ROOT)))
    assert len(where) > 500
    twice = {name: paths for name, paths in where.items() if len(paths) > 1}
    excepted = BOTH_SIDES | PUBLIC | SECTIONS
    assert {name: paths for name, paths in twice.items() if name not in excepted} == {}
    assert excepted == set(twice)  # an exception that is none any more goes
    for name in BOTH_SIDES:
        made, seen = sorted(twice[name], key=lambda path: not path.startswith("simulator/"))
        assert made.startswith("simulator/") and seen.startswith(("compensation/", "drivers/"))
