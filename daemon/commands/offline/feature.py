"""`armd feature`: fit geometric features to measured points; compute distances and angles."""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from armd.arrays import F64
from armd.compensation.features.fit import SHAPES, Feature, fit
from armd.compensation.features.relate import compute_angle, compute_distance
from armd.compensation.features.shapes import Shape
from armd.compensation.report.layout.written import add_pages
from armd.daemon.bridges.export.source import MeasurementLine, from_path
from armd.daemon.commands.offline import repeatability
from armd.errors import BadInput
from armd.files.outputs import RESULT, add_force, check_outputs
from armd.files.writing import write_whole
from armd.printable import to_printable
from armd.terminal.arguments import parse_positive

RELATIONS = ("distance", "angle")
REPEATABILITY = "repeatability"
#: `FILE:1-4,7`: rows of the file, from 1.
ROWS = re.compile(r"\d+(-\d+)?(,\d+(-\d+)?)*")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = (
        "a FILE is what `armd export` wrote (.csv) or measurements as published (JSON lines);\n"
        "FILE:1-4,7 takes these of its measurements, counted from 1\n\n"
        "  armd feature plane table.csv:1-9\n"
        "  armd feature cylinder bore.csv --tip-radius-mm 3 --inside\n"
        "  armd feature distance plane=table.csv:1-9 sphere=table.csv:10-20\n"
        "  armd feature repeatability SESSION --arm arm.toml: of one seat visited many times"
    )
    kinds = (*SHAPES, *RELATIONS, REPEATABILITY)
    parser.add_argument("kind", choices=kinds, metavar="KIND", help=", ".join(kinds))
    parser.add_argument(
        "operand",
        nargs="+",
        metavar="FILE[:ROWS]",
        help="of distance and angle two, KIND=FILE[:ROWS]; of repeatability a session's folder, or"
        " a table of points (x_mm, y_mm, z_mm; optionally a time)",
    )
    parser.add_argument("--json", metavar="OUT.json", help="the result for programs")
    parser.add_argument(
        "--tip-radius-mm",
        metavar="R",
        type=parse_positive,
        help="of a circle, sphere or cylinder: tell the radius of the surface touched, too",
    )
    parser.add_argument(
        "--inside", action="store_true", help="with --tip-radius-mm: a bore, touched from inside"
    )
    visits = parser.add_argument_group("repeatability")
    visits.add_argument("--arm", metavar="ARM.toml", help="what the arm is; of a session")
    visits.add_argument("--calibration", metavar="CAL.json", help="without it: nominal geometry")
    add_pages(parser, "of repeatability: a report with a picture of the visits over time")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    kind: str = args.kind
    if kind == REPEATABILITY:
        for option, value in (("--tip-radius-mm", args.tip_radius_mm), ("--inside", args.inside)):
            if value:
                raise BadInput("the command line", option, f"it with {kind}", "it with a sphere")
        return repeatability.run(args)
    for option in ("arm", "calibration", "report", "pdf"):
        if getattr(args, option) is not None:
            expected = f"it with {REPEATABILITY}"
            raise BadInput("the command line", f"--{option}", f"it with {kind}", expected)
    operands = [_parse_operand(kind, text) for text in args.operand]
    n_operands = 2 if kind in RELATIONS else 1
    if len(operands) != n_operands:
        problem = f"{len(operands)} operands"
        raise BadInput("the command line", f"armd feature {kind}", problem, str(n_operands))
    if args.inside and args.tip_radius_mm is None:
        raise BadInput("the command line", "--inside", "no --tip-radius-mm", "it as well")
    if args.tip_radius_mm is not None and kind not in ("circle", "sphere", "cylinder"):
        expected = "it with circle, sphere or cylinder"
        raise BadInput("the command line", "--tip-radius-mm", f"it with {kind}", expected)
    inputs = [path for _, path, _ in operands]
    check_outputs({"--json": (args.json, RESULT)}, inputs, args.force)
    features = [_fit_feature(*operand) for operand in operands]
    result: dict[str, Any] = {"schema": "armd.feature/1", "kind": kind}
    result["features"] = [feature.as_json() for feature in features]
    lines = [line for feature in features for line in _describe_feature(feature)]
    if kind in RELATIONS:
        words, figures = _relate_features(kind, *features)
        result |= figures
        lines.append(words)
    elif args.tip_radius_mm is not None:
        words, figures = _offset_surface(features[0], args.tip_radius_mm, args.inside)
        result |= figures
        lines.append(words)
    if args.json:
        write_whole(args.json, json.dumps(result, indent=1, allow_nan=False) + "\n")
    console = Console(soft_wrap=True, markup=False, highlight=False)
    for line in lines:
        console.print(line)
    return 0


Operand = tuple[Shape, Path, str]


def _parse_operand(kind: str, text: str) -> Operand:
    """Return a shape, a file, and rows ("" for all)."""
    shape, operand = kind, text
    if kind in RELATIONS:
        shape, equals, operand = text.partition("=")
        if not equals or shape not in SHAPES:
            expected = f"KIND=FILE[:ROWS], KIND one of {', '.join(SHAPES)}"
            raise BadInput("the command line", f"armd feature {kind}", repr(text), expected)
    file, colon, rows = operand.rpartition(":")
    if not colon or not ROWS.fullmatch(rows):
        file, rows = operand, ""
    shape_name = next(name for name in SHAPES if name == shape)
    return shape_name, Path(file), rows


def _fit_feature(shape: Shape, path: Path, rows: str) -> Feature:
    measured = from_path(path).measurements
    chosen = [measured[i] for i in _parse_numbers(path, rows, len(measured))]
    for number, measurement in enumerate(chosen, 1):
        if measurement.position_mm is None:
            location = f"measurement {number} of those chosen"
            raise BadInput(path, location, "no position", "valid ones: name their rows, FILE:ROWS")
    points = np.array([measurement.position_mm for measurement in chosen], dtype=float).reshape(
        -1, 3
    )
    try:
        return fit(shape, points, _stack_covariances(chosen))
    except ArithmeticError as error:
        raise BadInput(path, shape, str(error), "points that determine it") from error


def _parse_numbers(path: Path, rows: str, n: int) -> list[int]:
    """Return indices from 0, each once, in the order given."""
    if not rows:
        return list(range(n))
    row_indices: list[int] = []
    for part in rows.split(","):
        first, _, last = part.partition("-")
        low, high = int(first), int(last or first)
        if not 1 <= low <= high <= n:
            raise BadInput(path, f"rows {part}", f"{n} measurements", f"rows of 1 to {n}")
        row_indices += range(low - 1, high)
    return list(dict.fromkeys(row_indices))


def _stack_covariances(chosen: list[MeasurementLine]) -> F64 | None:
    """Return covariances (n, 3, 3) mm²; None unless every point has one."""
    matrices = []
    for measurement in chosen:
        if measurement.covariance_mm2 is None:
            return None
        xx, xy, xz, yy, yz, zz = measurement.covariance_mm2
        matrices.append([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return np.array(matrices, dtype=float)


def _describe_feature(feature: Feature) -> list[str]:
    content = feature.as_json()
    source = "points" if not feature.from_scatter else "residuals' scatter"
    lines = [f"{feature.shape}, {content['n']} points; U = 2 u (k = 2) from the {source}"]
    lines.append(
        f"  point      {_format_three(content['point_mm'], 4)} mm"
        + _format_expanded(content["point_standard_uncertainty_mm"], 4, " mm")
    )
    if content["direction"] is not None:
        lines.append(
            f"  direction  {_format_three(content['direction'], 6)}"
            + _format_expanded(content["direction_standard_uncertainty"], 6, "")
        )
    if content["radius_mm"] is not None:
        uncertain = content["radius_standard_uncertainty_mm"]
        lines.append(
            f"  radius     {content['radius_mm']:.4f} mm"
            + ("" if uncertain is None else f", U {2 * uncertain:.4f} mm")
            + " (of the tip's centre)"
        )
    lines.append(f"  form error {feature.form_error_mm:.4f} mm, RMS {feature.rms_mm:.4f} mm")
    return lines


def _format_three(values: list[float], digits: int) -> str:
    return "[" + ", ".join(f"{value:.{digits}f}" for value in values) + "]"


def _format_expanded(uncertainties: list[float] | None, digits: int, unit: str) -> str:
    if uncertainties is None:
        return ", U not known"
    return f", U {_format_three([2 * value for value in uncertainties], digits)}{unit}"


def _relate_features(kind: str, first: Feature, second: Feature) -> tuple[str, dict[str, Any]]:
    try:
        relation = (
            compute_distance(first, second) if kind == "distance" else compute_angle(first, second)
        )
    except ArithmeticError as error:
        raise BadInput(
            "the command line", f"armd feature {kind}", str(error), "two directions"
        ) from (error)
    unit, key = ("mm", "mm") if kind == "distance" else ("°", "deg")
    figures = {f"value_{key}": relation.value}
    figures[f"standard_uncertainty_{key}"] = relation.standard_uncertainty  # type: ignore[assignment]
    uncertain = relation.standard_uncertainty
    words = "not known" if uncertain is None else f"{2 * uncertain:.4f} {unit}"
    return to_printable(f"{kind} {relation.value:.4f} {unit}, U (k = 2) {words}"), figures


def _offset_surface(feature: Feature, tip_mm: float, inside: bool) -> tuple[str, dict[str, Any]]:
    """Compute the surface's radius from that of the ball's centre."""
    assert feature.radius_mm is not None  # circles, spheres and cylinders have one
    radius = feature.radius_mm + (tip_mm if inside else -tip_mm)
    if radius <= 0:
        problem = f"{feature.radius_mm:.4f} mm, less than the tip's {tip_mm:g} mm"
        raise BadInput("--tip-radius-mm", "the radius", problem, "--inside, or a smaller tip")
    words = f"  surface    radius {radius:.4f} mm, diameter {2 * radius:.4f} mm"
    return words, {"surface_radius_mm": radius}
