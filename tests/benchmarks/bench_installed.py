"""How much a controller takes on a disk: armd, its library, the packages of deploy/controller.txt.

Files as they are installed here, by the lists that pip keeps; compiled Python (`.pyc`) with
them. Python itself is the system's and not counted.
"""

from __future__ import annotations

from importlib.metadata import distribution
from pathlib import Path

import armd
from armd.compiled import library

PROJECT = Path(__file__).resolve().parents[2]
#: Of these alone nobody would expect to be without.
FLOOR = ("numpy", "eclipse-zenoh")


def run() -> dict[str, float]:
    """MB; of armd itself, and of what it requires."""
    required = {name: _size_mb(name) for name in _packages()}
    root = Path(armd.__file__).parent
    own_mb = sum(path.stat().st_size for path in root.rglob("*") if path.is_file()) / 1e6
    made = [path for path in library.list_places() if path.exists()]
    library_mb = made[0].stat().st_size / 1e6 if made and root not in made[0].parents else 0.0
    return {
        "mb": sum(required.values()) + own_mb + library_mb,
        "armd_mb": own_mb,
        "library_mb": library_mb,
        "numpy_and_zenoh_mb": sum(required[name] for name in FLOOR),
        **{f"{name}_mb": size for name, size in required.items()},
    }


def _packages() -> list[str]:
    lines = (PROJECT / "deploy/controller.txt").read_text(encoding="utf-8").splitlines()
    return sorted(line for line in lines if line and not line.startswith("#"))


def _size_mb(name: str) -> float:
    files = (Path(str(file.locate())) for file in distribution(name).files or ())
    return sum(path.stat().st_size for path in files if path.is_file()) / 1e6
