"""Run pytest; the few that failed beside other tests, and have deadlines, run once more, alone.

    python tests/twice.py -n 3 -m "not slow"

Three workers share two processors, with daemons, arms and subscribers of their own: a message can
come later there than a test waits for it. A test that is alone and fails again has failed, and so
has one that only computes, and so have all when they are more than a busy machine explains. What
passed the second time is named at the end.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from conftest import ONLY_COMPUTES

#: So many may fail at once for want of a processor; in whole runs on two cores it was one or two.
FEW = 4
SOME_FAILED = 1  # pytest's exit code; all others say that it was no run


def main(arguments: Sequence[str]) -> int:
    """Returns pytest's exit code, the second run's where there was one."""
    with tempfile.TemporaryDirectory() as cache:
        own_cache = ("-o", f"cache_dir={cache}")
        code = _pytest(*own_cache, *arguments)
        if code != SOME_FAILED:
            return code
        told = Path(cache) / "v" / "cache" / "lastfailed"
        failed = list(json.loads(told.read_text())) if told.is_file() else []
    final = [test for test in failed if "::" not in test or test.startswith(ONLY_COMPUTES)]
    if not failed or final or len(failed) > FEW:
        return code
    print(f"\narmd: {len(failed)} failed beside other tests and run once more, alone", flush=True)
    code = _pytest(*failed)
    if code == 0:
        print("armd: passed alone, though not beside other tests:", *failed, sep="\n  ")
    return code


def _pytest(*arguments: str) -> int:
    return subprocess.run([sys.executable, "-m", "pytest", *arguments], check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
