"""`make bench`: every benchmark in turn, as text and as `out/bench.json`.

`python tests/benchmarks/run.py [NAME …]` runs the named ones. Nothing here fails for being slow:
marks are printed beside what was reached.
"""

from __future__ import annotations

import importlib
import json
import os
import platform
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from armd.files.writing import write_whole

#: Modules bench_NAME beside this file, each with run() → (nested) figures.
NAMES = [
    "kernel", "wire", "daemon", "controller", "rate", "identify", "diagnose", "growth", "timing",
    "servo", "microscribe", "view",
]  # fmt: skip

#: figure → (least, most) that was aimed at
MARKS: dict[str, tuple[float | None, float | None]] = {
    "kernel.ratio_to_vectorised_c": (None, 1.3),
    "kernel.times_faster_than_scalar_c": (8.0, None),
    "daemon.start.cold_s": (None, 10.0),
    "daemon.start.warm_s": (None, 1.0),
    "daemon.1000_hz.undisturbed.p50_ratio": (None, 1.2),
    "daemon.1000_hz.undisturbed.p99_ratio": (None, 1.5),
    "daemon.1000_hz.undisturbed.p50_ratio_awake": (None, 2.0),
    "daemon.1000_hz.undisturbed.p99_ratio_awake": (None, 2.5),
    "daemon.1000_hz.cpu_percent_of_a_core": (None, 12.0),
    "daemon.1000_hz.rss_mb": (None, 120.0),
    "controller.1000_hz.cpu_percent_of_a_core": (None, 12.0),
    "controller.1000_hz.rss_mb": (None, 120.0),
    "controller.5000_hz.cpu_percent_of_a_core": (None, 10.0),
    "daemon.5000_hz.lost": (None, 0.0),
    "daemon.5000_hz.undisturbed.lost": (None, 0.0),
    "daemon.5000_hz.cpu_percent_of_a_core": (None, 10.0),
    "identify.ratio": (20.0, None),
    "diagnose.seconds": (None, 5.0),
    "growth.correct_peak_ratio": (None, 1.1),
    "growth.evaluate_peak_ratio": (None, 1.1),
    "servo.feetech.of_the_line": (0.9, None),
    "servo.feetech.lost": (None, 0.0),
    "servo.dynamixel.of_the_line": (0.9, None),
    "servo.dynamixel.lost": (None, 0.0),
}


def main(names: list[str]) -> int:
    results: dict[str, Any] = {
        "machine": {
            "python": platform.python_version(),
            "processor": _processor(),
            "cores": os.cpu_count(),
            "load_before": os.getloadavg()[0],
        }
    }
    for name in names or NAMES:
        figures = importlib.import_module(f"bench_{name}").run()
        results[name] = figures
        print(f"\n{name}")
        for figure, value in _flat(name, figures):
            mark = _mark(figure, value)
            print(f"  {figure.removeprefix(name + '.'):42} {_shown(value):>12}{mark}", flush=True)
    out = Path("out")
    out.mkdir(exist_ok=True)
    write_whole(out / "bench.json", json.dumps(results, indent=1) + "\n")
    print(f"\n{out / 'bench.json'} written")
    return 0


def _flat(name: str, figures: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(figures, dict):
        for key, value in figures.items():
            yield from _flat(f"{name}.{key}", value)
    else:
        yield name, figures


def _shown(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _mark(figure: str, value: float) -> str:
    if figure not in MARKS:
        return ""
    least, most = MARKS[figure]
    reached = (least is None or value >= least) and (most is None or value <= most)
    wanted = f"≥ {least:g}" if least is not None else f"≤ {most:g}"
    return f"   mark {wanted}: {'reached' if reached else 'NOT reached'}"


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.processor()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
