"""A virtual environment that is new, and finds armd and all it needs where we have it."""

from __future__ import annotations

import sysconfig
import venv
from pathlib import Path


def own_environment(folder: Path) -> Path:
    """Its Python; *folder* is made."""
    venv.create(folder, symlinks=True)
    (packages,) = folder.glob("lib/python*/site-packages")
    ours = sysconfig.get_path("purelib")
    (packages / "ours.pth").write_text(f"import site; site.addsitedir({ours!r})\n")
    return folder / "bin/python"
