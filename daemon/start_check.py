"""Check that the commands of this installation start: `python -I -m armd.daemon.start_check`.

All commands of a controller must start; of the others, those whose packages are installed.
"""

from __future__ import annotations

import sys

from armd.daemon.cli import OFFLINE, make_parsers

#: Commands that need none of the packages in `armd.daemon.cli.OFFLINE`.
CONTROLLER = (
    "accept", "arm", "check", "completion", "doctor", "export", "fleet", "init", "ippdme", "man",
    "record", "reload", "replay", "ros2", "run", "schema", "status", "stream", "tip", "view",
    "watch",
)  # fmt: skip
OTHERS = (
    "calibrate", "compensate", "correct", "demo", "design", "diagnose", "evaluate", "feature",
    "import", "interim", "measure", "model", "recorrect", "verify",
)  # fmt: skip


def find_faults() -> dict[str, str]:
    """Return the commands that do not start, and why."""
    faults = {}
    for name in (*CONTROLLER, *OTHERS):
        try:
            _, commands = make_parsers([name])
            commands[name].format_help()
        except Exception as error:
            absent = error.name if isinstance(error, ModuleNotFoundError) else None
            if name in CONTROLLER or (absent or "").partition(".")[0] not in OFFLINE:
                faults[name] = f"{type(error).__name__}: {error}"
    return faults


def main() -> int:
    """Check all commands; return 2 where one does not start, else 0."""
    faults = find_faults()
    for name, fault in faults.items():
        print(f"armd: {name}: found {fault}, expected a command that starts", file=sys.stderr)
    return 2 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
