"""The build backend: setuptools', which for a wheel also asks for what compiles armd's functions.

A wheel built on Linux with a C++ compiler carries the library of compiled functions (setup.py).
Who builds without one is spared the download of numba; such a wheel compiles when it is used.
"""

from __future__ import annotations

import os
import shutil
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403

PROJECT = Path(__file__).resolve().parents[2]
#: What `python -m armd.compiled.ahead` imports, of armd's own dependencies.
FOR_LIBRARY = ("cobs", "fastcrc", "numba", "numpy", "platformdirs", "pydantic", "pyserial")


def get_requires_for_build_wheel(config_settings: Mapping[str, Any] | None = None) -> list[str]:
    """setuptools' own, and those of the library where one will be made."""
    needed: list[str] = build_meta.get_requires_for_build_wheel(config_settings)
    compiler = shutil.which("c++") or shutil.which("g++") or os.environ.get("CXX")
    if sys.platform != "linux" or not compiler or os.environ.get("ARMD_WITHOUT_LIBRARY"):
        return needed
    settings = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))
    dependencies: list[str] = settings["project"]["dependencies"]
    return needed + [each for each in dependencies if each.startswith(FOR_LIBRARY)]
