"""The daemon needs no permission but its port's: refuse a service that runs as root.

A service that runs as root is a mistake that nobody notices, so it is refused. In a container, in a
test or for a short manual run root may be the only user: the daemon runs, and warns visibly.
"""

from __future__ import annotations

import os

from armd.errors import BadInput

WARNING = "armd runs as root, which it never needs: give it its own user (docs/how-to/secure.md)"


def is_root() -> bool:
    return os.geteuid() == 0


def refuse_root_service(allowed: bool) -> None:
    """Raise `BadInput` where systemd itself started this process as root."""
    if is_root() and _is_service() and not allowed:
        expected = "a user of its own (User=armd), or armd run --allow-root"
        raise BadInput("systemd unit", "User", "root", expected)


def _is_service() -> bool:
    """Return whether systemd started this process; it names it (since version 248).

    A process further down, such as a test on a machine whose shell belongs to a service, has the
    variable too, but another process number.
    """
    return os.environ.get("SYSTEMD_EXEC_PID") == str(os.getpid())
