"""Find packages that are not installed, and the command that installs them."""

from __future__ import annotations

import re
import sys
from collections.abc import Collection
from importlib.metadata import PackageNotFoundError, requires
from importlib.util import find_spec


def suggest_installation(packages: Collection[str], package: str) -> str:
    """Return the command that installs *package* and other missing ones of *packages*.

    It names the versions that armd needs.
    """
    missing = sorted(name for name in packages if name == package or find_spec(name) is None)
    versions = {re.split(r"[^\w.-]", text)[0]: text.split(";")[0].strip() for text in _required()}
    # A package without a known version comes with another one: llvmlite with numba.
    requirements = [versions[name] for name in missing if name in versions] or missing
    return f"{sys.executable} -m pip install {' '.join(map(_quote, requirements))}"


def _required() -> list[str]:
    try:
        return requires("armd") or []
    except PackageNotFoundError:  # armd is not installed
        return []


def _quote(requirement: str) -> str:
    return f"'{requirement}'" if re.search("[<>~!*]", requirement) else requirement
