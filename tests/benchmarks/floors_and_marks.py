"""What was aimed at, beside what was reached and beside its floor: what it stands on, alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Mark:
    """One figure of a benchmark, and how it is judged. Figures are named BENCH.KEY.KEY…"""

    figure: str
    unit: str = ""
    most: float | None = None
    least: float | None = None
    floor: str = ""  # the figure of the floor, if one is measured
    floor_is: str = ""
    ratio: bool = False  # the mark is a multiple of the floor, not in the figure's unit


ZENOH = "Zenoh alone"
ZENOH_AWAKE = "Zenoh alone, awake"


def _latency(percentile: str, most: float, alone: str, alone_is: str) -> Mark:
    room = "daemon.1000_hz.undisturbed."
    figure, floor = (f"{room}{name}.{percentile}_us" for name in ("latency", alone))
    return Mark(figure, "µs", most, floor=floor, floor_is=alone_is, ratio=True)


MARKS = [
    Mark("kernel.ratio_to_vectorised_c", most=1.0),
    Mark(
        "kernel.operations_per_ns", "/ns", None, None,
        "kernel.multiply_add_operations_per_ns", "multiply-adds in registers",
    ),
    *(
        Mark(
            f"kernel.covariance.{way}_ns", "ns", most, None,
            "kernel.covariance.product_alone_ns", "BLAS multiplies alone",
        )
        for way, most in (("batch", 500), ("live", 2000))
    ),
    Mark("kernel.times_faster_than_scalar_c", least=8),
    *(
        Mark(
            f"daemon.start.{state}_s", "s", most, None, "daemon.start.bare_s", "Zenoh opened alone"
        )
        for state, most in (("cold", 10), ("without_library_cold", 10), ("warm", 1))
    ),
    _latency("p50", 1.2, "zenoh_alone", ZENOH),
    _latency("p99", 1.5, "zenoh_alone", ZENOH),
    _latency("p50", 1.3, "zenoh_alone_awake", ZENOH_AWAKE),
    _latency("p99", 1.5, "zenoh_alone_awake", ZENOH_AWAKE),
    *(
        Mark(
            f"{bench}.{hz}_hz.cpu_percent_of_a_core", "%", most, None,
            f"{bench}.{hz}_hz.zenoh_alone_cpu_percent_of_a_core", ZENOH, ratio,
        )
        for hz, most, ratio in ((1000, 1.15, True), (5000, 10, False))
        for bench in ("daemon", "controller")
    ),
    *(
        Mark(
            f"{bench}.1000_hz.rss_mb", "MB", 60, None,
            f"{bench}.1000_hz.zenoh_alone_rss_mb", ZENOH,
        )
        for bench in ("daemon", "controller")
    ),
    Mark("rate.10000_hz.processor_percent", "%", 20),
    Mark("daemon.5000_hz.lost", most=0),
    Mark("daemon.5000_hz.undisturbed.lost", most=0),
    Mark("installed.mb", "MB", 300, None, "installed.numpy_and_zenoh_mb", "numpy and Zenoh"),
    Mark("identify.ratio", least=20),
    *(
        Mark(
            f"diagnose.{size}_readings.seconds", "s", most, None,
            "diagnose.imports_s", "its imports",
        )
        for size, most in ((600, 4), (2000, 8), (6000, 60), (20000, 60))
    ),
    Mark("diagnose.6000_readings.peak_mb", "MB", 1000),
    Mark("diagnose.20000_readings.peak_mb", "MB", 2000),
    *(
        Mark(f"calibrate.{n}.seconds", "s", most, None, f"calibrate.{n}.floor_s", "20 dense steps")
        for n, most in (("2000_readings", 5), ("20000_readings", 60))
    ),
    Mark("calibrate.20000_readings.peak_mb", "MB", 2000),
    Mark(
        "calibrate.20000_readings.processor_s", "s", 5, None,
        "calibrate.20000_readings.floor_s", "20 dense steps",
    ),
    Mark("calibrate.verify.processor_s", "s", 2, None, "calibrate.verify.floor_s", "its imports"),
    *(
        mark
        for command in ("correct", "evaluate")
        for mark in (
            Mark(
                f"growth.{command}_processor_us_a_reading", "µs", 1.5, None,
                "growth.duckdb_copy_processor_us_a_reading", "DuckDB reads and writes", True,
            ),
            Mark(f"growth.{command}_times_duckdb_copy", "", 1.5),
        )
    ),
    Mark(
        "growth.correct_peak_ratio", "", 1.1, None,
        "growth.duckdb_copy_peak_ratio", "DuckDB reads and writes",
    ),
    Mark(
        "growth.evaluate_peak_ratio", "", 1.1, None,
        "growth.duckdb_read_peak_ratio", "DuckDB reads",
    ),
    Mark("python.imports.armd.seconds", "s", 0.2, None, "python.imports.python.seconds", "Python"),
    *(
        Mark(f"python.table.{kind}.{name}_ratio", "", most)
        for kind in ("one_temperature", "steps_of_500_rows")
        for name, most in (("corrector", 1.3), ("corrector_with_uncertainty", 5))
    ),
    *(
        mark
        for bus in ("feetech", "dynamixel")
        for mark in (
            Mark(
                f"servo.{bus}.of_the_line", "", None, 0.9,
                f"servo.{bus}.bare_client_of_the_line", "a client in C",
            ),
            Mark(f"servo.{bus}.lost", most=0),
        )
    ),
]  # fmt: skip


def table(figures: Mapping[str, object]) -> list[str]:
    """Lines: each mark whose figure there is, with floor and verdict."""
    rows = [
        (mark.figure, *_cells(mark, value, figures.get(mark.floor)))
        for mark in MARKS
        if isinstance(value := figures.get(mark.figure), int | float)
    ]
    head = ("figure", "reached", "floor", "mark", "")
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in ([head, *rows] if rows else [])
    ]


def _cells(mark: Mark, value: float, floor: object) -> tuple[str, str, str, str]:
    measured = isinstance(floor, int | float)
    beside = f"{_shown(floor, mark.unit)} {mark.floor_is}" if measured else "—"
    if mark.ratio:
        judged = value / floor if measured else None
        unit = "× the floor"
    else:
        judged, unit = value, mark.unit
    limit = mark.most if mark.least is None else mark.least
    if limit is None:
        return _shown(value, mark.unit), beside, "—", ""
    wanted = f"{'≤' if mark.least is None else '≥'} {_shown(limit, unit)}"
    if judged is None:
        return _shown(value, mark.unit), beside, wanted, "no floor"
    reached = judged <= limit if mark.least is None else judged >= limit
    told = f"{judged:.3g}: " if mark.ratio else ""
    verdict = f"{told}{'reached' if reached else 'NOT reached'}"
    return _shown(value, mark.unit), beside, wanted, verdict


def _shown(value: float, unit: str) -> str:
    number = f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    return f"{number} {unit}".rstrip()
