"""`python -m armd`: the command line, where its script is not on the path."""

from __future__ import annotations

import sys


def main() -> int:
    """Run the command; return its exit code."""
    try:
        from armd.daemon.cli import main
    except ModuleNotFoundError as error:
        if not (error.name or "").startswith("armd"):
            raise
        print("armd: this is the client alone, without commands", file=sys.stderr)
        return 2
    return main()


if __name__ == "__main__":
    sys.exit(main())
