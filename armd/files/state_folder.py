"""The folder of the data that must outlive a daemon."""

from __future__ import annotations

import os
from pathlib import Path

import platformdirs


def find_state_folder() -> Path:
    """Return `$STATE_DIRECTORY` (systemd's), else `$XDG_STATE_HOME/armd`, else the system's."""
    systemd_folder = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
    return Path(systemd_folder) if systemd_folder else Path(platformdirs.user_state_dir("armd"))
