"""Stations of the tests of `armd verify`, by the targets' names (docs/how-to/verify.md)."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from armd.daemon.measure.plan.stations import Station, plan_rounds

#: Readings of a seat, each in another posture: ASME B89.4.22 requires them of a single point.
SEAT_READINGS = 10
SPAT = ("SPAT1", "SPAT2", "SPAT3")
SPAT_WHERE = ("near the column", "in the middle of the reach", "far out")
LENGTHS = tuple(f"L{i}" for i in range(6))
SEAT_HOW = "the tip in the seat, the arm in another posture than before"

#: Test → its points on a sphere, numbered as in docs/how-to/verify.md.
SPHERE_POINTS: dict[str, list[str]] = {
    "probing": [f"SPHERE{number}.{i:02d}" for number in (1, 2) for i in range(1, 26)],
    "l_dia": [f"LDIA.{k}.{i}" for k in range(1, 6) for i in range(1, 6)],
    "effective_diameter": [f"EFFDIA.{k}.{i}" for k in range(1, 4) for i in range(1, 10)],
}


def _select_by_prefix(names: Sequence[str], prefix: str) -> list[str]:
    return [name for name in names if name.startswith(prefix)]


def _plan_spheres(names: Sequence[str]) -> list[Station]:
    return [
        Station(placement=placement, target=name, how=_describe_on_sphere(name))
        for placement in ("SPHERE1", "SPHERE2")
        for name in _select_by_prefix(names, f"{placement}.")
    ]


def _plan_orientations(names: Sequence[str]) -> list[Station]:
    return [
        Station(
            placement="LDIA", target=name, how=f"{_describe_on_sphere(name)}; arm in posture {k}"
        )
        for k in range(1, 6)
        for name in _select_by_prefix(names, f"LDIA.{k}.")
    ]


def _plan_effective(names: Sequence[str]) -> list[Station]:
    return [
        Station(placement="EFFDIA", target=name, how=_describe_on_sphere(name))
        for name in _select_by_prefix(names, "EFFDIA.")
    ]


def _plan_single_points(names: Sequence[str]) -> list[Station]:
    if not set(SPAT) <= set(names):
        return []
    return [
        Station(placement="SPAT", target=seat, how=f"a seat {position}: {SEAT_HOW}")
        for seat, position in zip(SPAT, SPAT_WHERE, strict=True)
        for _ in range(SEAT_READINGS)
    ]


def _plan_lengths(names: Sequence[str]) -> list[Station]:
    if not set(LENGTHS) <= set(names):
        return []
    placements = [f"E_UNI{i}" for i in range(1, 8)]
    return plan_rounds(placements, LENGTHS, 3, "the length bar, from one end to the other")


def _plan_volumetric(names: Sequence[str]) -> list[Station]:
    if not {"BARS.a", "BARS.b", "BARL.a", "BARL.b"} <= set(names):
        return []
    return [
        Station(
            placement=f"VOL{i}", target=f"{bar}.{end}", how="one end of the bar, then the other"
        )
        for i in range(1, 21)
        for bar in ["BARS" if i % 2 else "BARL"]
        for end in "ab"
    ]


#: The tests of `--tests`, in the order of measuring.
TESTS: dict[str, Callable[[Sequence[str]], list[Station]]] = {
    "probing": _plan_spheres,
    "l_dia": _plan_orientations,
    "effective_diameter": _plan_effective,
    "spat": _plan_single_points,
    "e_uni": _plan_lengths,
    "volumetric": _plan_volumetric,
}


def _describe_on_sphere(name: str) -> str:
    """Describe a point's place: points are numbered from the pole down, ring by ring."""
    number = int(re.sub(r"\D", "", name.rpartition(".")[2]) or "0")
    region = "at the pole" if number == 1 else "farther down, all around"
    return f"touch the sphere {region} (docs/how-to/verify.md has the pattern)"
