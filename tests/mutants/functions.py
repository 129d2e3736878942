"""The test functions of a file: their lines, and a digest of them by which a changed one shows."""

from __future__ import annotations

import ast
import hashlib
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class TestFunction:
    __test__ = False  # for pytest

    line: int  # of its first decorator
    count: int  # of lines
    digest: str


def split_test(test: str) -> tuple[str, str]:
    """The file and the function of a test, for all its parameters; a method as Class::name."""
    path, _, name = test.partition("::")
    return path, name.partition("[")[0]


def read_functions(path: Path) -> dict[str, TestFunction]:
    """Every function of the file, and every method as Class::name."""
    text = path.read_text(encoding="utf-8")
    functions: dict[str, TestFunction] = {}
    lines = text.splitlines()

    def read(body: list[ast.stmt], prefix: str) -> None:
        for node in body:
            if isinstance(node, ast.ClassDef):
                read(node.body, f"{prefix}{node.name}::")
            elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                first = min([node.lineno, *(one.lineno for one in node.decorator_list)])
                own = lines[first - 1 : node.end_lineno]
                digest = hashlib.sha256("\n".join(own).encode()).hexdigest()[:12]
                functions[prefix + node.name] = TestFunction(first, len(own), digest)

    read(ast.parse(text).body, "")
    return functions


def digest_test(root: Path, test: str) -> str:
    """Of the test's function as it is written in *root*; empty where there is none."""
    path, name = split_test(test)
    if not (root / path).is_file():
        return ""
    function = read_functions(root / path).get(name)
    return function.digest if function is not None else ""
