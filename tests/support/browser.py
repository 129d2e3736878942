"""The browser that tests and pictures are made with."""

from __future__ import annotations

import shutil


def find_browser() -> str | None:
    """Return its path; None: `make browser` installs one."""
    return shutil.which("chromium") or shutil.which("google-chrome")
