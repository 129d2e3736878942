"""At most eight values are told apart by their place: of a function, a constructor, a call."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("armd", "drivers", "compensation", "daemon", "simulator")
MOST = 8
#: numba compiles no keyword-only argument, and passes a `NamedTuple` of arrays as one argument;
#: `armd.Point` has the fields of the wire in their order, and programs take it apart by it.
EXEMPT = {
    "armd/point.py": 1,
    "drivers/serial/assembler.py": 4,
    "compensation/kernel/memory.py": 4,
    "compensation/kernel/model.py": 1,
    "compensation/kernel/points.py": 2,
    "compensation/kernel/row_variances.py": 3,
    "compensation/kernel/slow_factors.py": 1,
    "compensation/model/kinematics.py": 3,
    "daemon/live/pipeline.py": 1,
}


def _n_fields(node: ast.ClassDef) -> int:
    """Fields that a constructor takes by their place; 0 of what is no record."""
    decorators = [ast.unparse(decorator) for decorator in node.decorator_list]
    is_dataclass = any(decorator.startswith("dataclass") for decorator in decorators)
    is_tuple = any(ast.unparse(base) == "NamedTuple" for base in node.bases)
    if not (is_dataclass or is_tuple) or any("kw_only=True" in d for d in decorators):
        return 0
    n = 0
    for field in node.body:
        if not isinstance(field, ast.AnnAssign):
            continue
        annotation = ast.unparse(field.annotation)
        if annotation == "KW_ONLY":
            break
        default = ast.unparse(field.value) if field.value else ""
        is_given = "init=False" in default or "kw_only=True" in default
        n += not is_given and not annotation.startswith("ClassVar")
    return n


def find_long_places(tree: ast.AST) -> Iterator[str]:
    """Yield each function, record and call with more than eight values by place."""
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                names = [argument.arg for argument in node.args.posonlyargs + node.args.args]
                n = len(names) - (names[:1] in (["self"], ["cls"]))
                what = f"{node.name}() takes"
            case ast.ClassDef():
                n, what = _n_fields(node), f"{node.name} has"
            case ast.Call():
                n = sum(not isinstance(argument, ast.Starred) for argument in node.args)
                what = f"a call of {ast.unparse(node.func)} gives"
            case _:
                continue
        if n > MOST:
            yield f"{getattr(node, 'lineno', 0)}: {what} {n}"


def places(package: str) -> dict[str, list[str]]:
    """By file of the project; armd/ has links to the other packages, which are not followed."""
    files = [path for path in (ROOT / package).rglob("*.py") if "__pycache__" not in path.parts]
    assert files, package
    return {
        str(path.relative_to(ROOT)): found
        for path in sorted(files)
        if (found := list(find_long_places(ast.parse(path.read_text(encoding="utf-8")))))
    }


@pytest.mark.parametrize("package", PACKAGES)
def test_no_more_than_eight_values_by_their_place(package: str) -> None:
    found = places(package)
    exempt = {file: n for file, n in EXEMPT.items() if file.split("/")[0] == package}
    assert {file: len(found.get(file, [])) for file in exempt} == exempt
    assert {file: lines for file, lines in found.items() if file not in exempt} == {}


def test_each_kind_is_found() -> None:
    eight, nine = "abcdefgh", "abcdefghi"
    for names, n in ((eight, 0), (nine, 4)):
        fields = "".join(f"    {name}: int\n" for name in names)
        text = (
            f"def f({', '.join(names)}, *, z): ...\n"
            f"@dataclass(frozen=True)\nclass A:\n{fields}    _: KW_ONLY\n    y: int\n"
            f"class B(NamedTuple):\n{fields}"
            f"f({', '.join(names)}, z=1)\n"
            f"@dataclass(kw_only=True)\nclass C:\n{fields}"
        )
        assert len(list(find_long_places(ast.parse(text)))) == n, text
