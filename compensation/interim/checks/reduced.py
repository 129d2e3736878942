"""What one check says of the arm: whitened rows, clear of placements and seats.

Rows z ~ N(columns · amplitudes, I): residuals under the calibration, at the temperatures that were
there, per standard deviation of a reading. Everything else about a check (where the artefact stood,
where its seats are) is projected out, so two checks may stand anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from armd.arrays import F64


@dataclass(frozen=True, kw_only=True)
class Reduced:
    """What one check says: r whitened rows on C named columns."""

    residual: F64  # (r,)
    causes: F64  # (r, K) per unit of each cause's columns, in the order of `list_causes`
    error_columns: F64  # (r, B) what may be wrong all along, per standard deviation
    known_names: tuple[str, ...]  # (B,) the same name is the same unknown in every check
    targets: F64  # (r, 3 T) per mm of a target's shift
    target_names: tuple[str, ...]  # (T,) artefact and target
    certified: tuple[bool, ...]  # (T,) whether its place is known beforehand
    mean_unix_s: float
    first_unix_s: float
    last_unix_s: float
    readings: int
    rms_um: float  # of the residuals after placements and seats, per reading, 3-D
    catalogue: str  # `digest` of the causes that the columns are of
    #: the lowest and highest of each sensor
    temperature_c: dict[str, tuple[float, float]] = field(default_factory=dict)
