"""What the checks ask of the controller they run on."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable
from pathlib import Path

PAYLOAD = Path("/mnt")
UNIT = "armd.service"


def sh(command: str) -> str:
    """Run a shell command; what it printed, or an error that shows it."""
    run = subprocess.run(command, shell=True, capture_output=True, text=True)
    assert run.returncode == 0, f"{command}: {run.returncode}: {run.stdout}{run.stderr}"
    return run.stdout.strip()


def show(name: str, unit: str = UNIT) -> str:
    """A property of a unit, e.g. `show("MainPID")`."""
    return sh(f"systemctl show --value --property={name} {unit}")


def wait_for(condition: Callable[[], bool], seconds: float, what: str) -> float:
    """Wait until *condition* holds; the seconds it took. Fails saying *what* did not come."""
    start_s = time.monotonic()
    while not condition():
        waited_s = time.monotonic() - start_s
        assert waited_s < seconds, f"{what}: not within {seconds} s"
        time.sleep(0.1)
    return time.monotonic() - start_s


def journal(unit: str = UNIT) -> str:
    return sh(f"journalctl --boot --no-pager --output=cat --unit={unit}")


def nothing_is_left() -> None:
    """Fails if a file or a user of armd's is still there."""
    left = sh("find / -xdev '(' -name '*armd*' -o -user armd ')' -not -path '/var/log/*' "
              "-not -name 'armd-system-test.service' 2>/dev/null || true")  # fmt: skip
    assert not left, left
    assert sh("getent passwd armd || echo none") == "none"
