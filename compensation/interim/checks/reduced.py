"""A check as whitened rows from which placements and seats are eliminated.

Rows z ~ N(columns · amplitudes, I): residuals under the calibration, at the measured temperatures,
in standard deviations of a reading. All nuisances of a check (pose of the artefact, positions of
its seats) are projected out, so two checks may have different placements.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from armd.arrays import F64


@dataclass(frozen=True, kw_only=True)
class Reduced:
    """One check as r whitened rows on C named columns."""

    residual: F64  # (r,)
    causes: F64  # (r, K) per unit of each cause's columns, in the order of `list_causes`
    error_columns: F64  # (r, B) calibration's and certificates' errors, per standard deviation
    known_names: tuple[str, ...]  # (B,) the same name is the same unknown in every check
    targets: F64  # (r, 3 T) per mm of a target's shift
    target_names: tuple[str, ...]  # (T,) artefact and target
    certified: tuple[bool, ...]  # (T,) whether its position is certified
    mean_unix_s: float
    first_unix_s: float
    last_unix_s: float
    readings: int
    rms_um: float  # of the residuals after placements and seats, per reading, 3-D
    catalogue: str  # `hash_catalogue` of the causes of the columns
    #: the lowest and highest temperature of each sensor
    temperature_c: dict[str, tuple[float, float]] = field(default_factory=dict)
