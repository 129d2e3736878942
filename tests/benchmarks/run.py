"""`make bench`: every benchmark in turn, as text and as `out/bench.json`; at the end a table of all
marks, each with what was reached and, measured in the same run, its floor.

`PYTHONPATH=tests python tests/benchmarks/run.py [NAME …]` runs the named ones. Nothing here fails
for being slow.
"""

from __future__ import annotations

import importlib
import json
import os
import platform
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from floors_and_marks import table

from armd.files.writing import write_whole

#: Modules bench_NAME beside this file, each with run() → (nested) figures; some with shown(figures)
#: → lines of a table of their own.
NAMES = [
    "kernel", "stages", "daemon", "controller", "rate", "installed", "identify",
    "calibrate", "diagnose", "growth", "servo", "microscribe", "view", "python",
]  # fmt: skip


def main(names: list[str]) -> int:
    results: dict[str, Any] = {
        "machine": {
            "python": platform.python_version(),
            "processor": _processor(),
            "cores": os.cpu_count(),
            "load_before": os.getloadavg()[0],
        }
    }
    everything: dict[str, Any] = {}
    failed: list[str] = []
    for name in names or NAMES:
        try:
            bench = importlib.import_module(f"bench_{name}")
            figures = bench.run()
        except Exception:  # an hour of what the others measured is not lost with it
            traceback.print_exc()
            failed.append(name)
            continue
        results[name] = figures
        print(f"\n{name}")
        for figure, value in _flat(name, figures):
            everything[figure] = value
            print(f"  {figure.removeprefix(name + '.'):42} {_shown(value):>12}", flush=True)
        if hasattr(bench, "shown"):
            print("", *bench.shown(figures), sep="\n  ", flush=True)
    print("", *table(everything), sep="\n")
    out = Path("out")
    out.mkdir(exist_ok=True)
    write_whole(out / "bench.json", json.dumps(results, indent=1) + "\n")
    print(f"\n{out / 'bench.json'} written")
    if failed:
        print(f"not measured: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


def _flat(name: str, figures: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(figures, dict):
        for key, value in figures.items():
            yield from _flat(f"{name}.{key}", value)
    else:
        yield name, figures


def _shown(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.processor()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
