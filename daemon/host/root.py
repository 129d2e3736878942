"""The daemon needs no right but its port's. What it does when it finds itself root.

A service that runs as root is a mistake that nobody notices: it is refused. In a container, in a
test or for a moment by hand root may be all there is: it runs, and says so wherever a person looks.
"""

from __future__ import annotations

import os

from armd.errors import BadInput

WARNING = "armd runs as root, which it never needs: give it its own user (docs/how-to/secure.md)"


def is_root() -> bool:
    return os.geteuid() == 0


def refuse_root_service(allowed: bool) -> None:
    """Raises `BadInput` where systemd itself started this process as root."""
    if is_root() and _is_service() and not allowed:
        expected = "a user of its own (User=armd), or armd run --allow-root"
        raise BadInput("systemd unit", "User", "root", expected)


def _is_service() -> bool:
    """systemd names the process it starts (since version 248). A process further down, such as a
    test on a machine whose shell is some service's, has the variable too, but another number."""
    return os.environ.get("SYSTEMD_EXEC_PID") == str(os.getpid())
