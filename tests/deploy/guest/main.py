"""Runs inside the guest: the checks of one stage; what they found goes out on a disk.

The kernel's command line says which stage and which disk. Only Python's standard library.
"""

from __future__ import annotations

import importlib
import io
import json
import subprocess
import sys
import tarfile
import time
import traceback
from pathlib import Path


def main() -> None:
    line = Path("/proc/cmdline").read_text().split()
    words = dict(word.split("=", 1) for word in line if "=" in word)
    results = []
    for check in importlib.import_module(f"stage_{words['armd.stage']}").CHECKS:
        start_s = time.monotonic()
        try:
            detail, passed = check() or "", True
        except Exception:  # whatever a check dies of is its result
            detail, passed = traceback.format_exc(), False
        seconds = time.monotonic() - start_s
        name = check.__name__
        results.append({"name": name, "passed": passed, "detail": detail, "seconds": seconds})
        print(f"{'pass' if passed else 'FAIL'} {name} {seconds:.1f} s {detail}", flush=True)
        if not passed:
            break  # what state it left the machine in, nobody knows
    journal = ["journalctl", "--boot", "--no-pager", "--output=short-monotonic"]
    report = {
        "results.json": json.dumps(results).encode(),
        "journal.txt": subprocess.run(journal, capture_output=True).stdout,
    }
    with tarfile.open(words["armd.results"], "w") as archive:
        for name, content in report.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(content)
            archive.addfile(entry, io.BytesIO(content))


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent))
    main()
