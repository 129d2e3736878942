"""`read_calibration`, and the calibration that `calibrate` returns."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armd.arrays import F64
from armd.compensation.model import parameters
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration as Content
from armd.compensation.model.calibration import (
    LoadedCalibration,
    check_belongs,
    load_calibration,
    save_calibration,
)
from armd.errors import ArmdError
from armd.files.writing import write_whole
from armd.offline.arm_model import ArmModel, PathText
from armd.offline.results.arrow_table import ArrowTable
from armd.offline.results.display import Displayed, Facts

if TYPE_CHECKING:  # these take long to load
    from armd.compensation.report.layout.about import About
    from armd.offline.results.identified import Identified


class Calibration(Displayed):
    """Identified constants and terms of one arm, with their covariance.

    `read_calibration` and `calibrate` make it; it does not change.
    """

    def __init__(self, loaded: LoadedCalibration, identified: Identified | None = None) -> None:
        #: the calibration in the form of armd's own functions; not public
        self.loaded = loaded
        #: the result of its identification, where `calibrate` made it; not public
        self.identified = identified

    @property
    def content(self) -> Content:
        """The checked content in the form of armd's own functions; not public."""
        return self.loaded.content

    @property
    def arm(self) -> str:
        """The serial number of the arm to which it belongs."""
        return self.content.arm

    @property
    def path(self) -> Path:
        """The file from which it was read; `calibration` if it was never a file."""
        return self.loaded.path

    @property
    def sha256(self) -> str:
        """The SHA-256 of the file that `save` writes, hexadecimal: its identity."""
        return self.loaded.sha256

    @property
    def rms_um(self) -> float:
        """The 3-D RMS in µm of the readings of the identification; NaN where not recorded."""
        return self._recorded("rms_um")

    @property
    def heldout_rms_um(self) -> float:
        """The 3-D RMS in µm on held-out readings; NaN where not recorded."""
        return self._recorded("heldout_rms_um")

    @property
    def covariance_of(self) -> list[str]:
        """The names of the identified quantities: parameters, and `term I` (I from 0)."""
        return list(self.content.covariance_of)

    @property
    def covariance(self) -> F64:
        """The covariance (K, K) of the quantities in `covariance_of`, in products of mm and rad."""
        count = len(self.content.covariance_of)
        return np.array(self.content.covariance, dtype=np.float64).reshape(count, count)

    @property
    def parameters(self) -> ArrowTable:
        """A table of all parameters, then all terms, with values and uncertainties.

        Its columns are `name, unit, nominal, value, standard_uncertainty`. Lengths are in mm,
        angles in rad. `nominal` is the value in arm.toml; it is missing in a calibration that was
        read from a file. A term is called `term I`, as in `covariance_of`; its value is its
        coefficient, its nominal value 0. `standard_uncertainty` (k = 1) is missing where a quantity
        was not identified.
        """
        content = self.content
        uncertainty_of = dict(
            zip(self.covariance_of, np.sqrt(np.diag(self.covariance)), strict=True)
        )
        nominal: dict[str, float] = {}
        if self.identified is not None:
            arm = self.identified.arm.content
            nominal = dict(zip(arm.layout.names, arm.nominal().tolist(), strict=True))
        names = [*content.constants, *(f"term {i}" for i in range(len(content.terms)))]
        units = [parameters.find_unit(name) for name in content.constants]
        units += [f"{parameters.find_unit(term.parameter)}/basis" for term in content.terms]
        return ArrowTable(
            {
                "name": names,
                "unit": units,
                "nominal": np.array(
                    [nominal.get(name, math.nan) for name in content.constants]
                    + [0.0] * len(content.terms)
                ),
                "value": np.array(
                    [*content.constants.values(), *(term.coefficient for term in content.terms)]
                ),
                "standard_uncertainty": np.array(
                    [float(uncertainty_of.get(name, math.nan)) for name in names]
                ),
            }
        )

    @property
    def figures(self) -> dict[str, Any] | None:
        """The output of `armd calibrate --json`; None for a calibration that was read."""
        return None if self.identified is None else self.identified.result.as_json()

    def to_dict(self) -> dict[str, Any]:
        """Return the file's content as plain data, as `json` reads it."""
        content: dict[str, Any] = json.loads(self.loaded.data)
        return content

    def save(self, path: PathText) -> None:
        """Write the calibration file, as `armd calibrate -o` does.

        The file appears completely or not at all; an existing one is replaced. A calibration that
        was read is written byte by byte. Raises `armd.BadInput` where nothing can be written.
        """
        write_whole(Path(path), self.loaded.data)

    def report(self, path: PathText) -> None:
        """Write the report of `armd calibrate` to *path*: HTML, or PDF by its suffix `.pdf`.

        Raises `armd.ArmdError` for a calibration that was read, or where no program prints a PDF.
        """
        from armd.compensation.report.layout.written import write_page

        write_page(Path(path), self.page(self.path.name))

    def page(self, written: str, about: About | None = None) -> str:
        """Return the report as HTML. Not public.

        *written*: the name of the calibration's file in it; *about*: data for its head.
        """
        from armd.offline.results.pages import draw_calibration_page

        if self.identified is None:
            raise ArmdError(f"{self.path}: no report: its sessions are not at hand")
        loaded = replace(self.loaded, path=Path(written))
        return draw_calibration_page(self.identified, loaded, about)

    def for_arm(self, arm: Arm) -> LoadedCalibration:
        """Return the form of armd's functions; raises `BadInput` for another arm. Not public."""
        check_belongs(self.path, self.content, arm)
        return self.loaded

    def _recorded(self, name: str) -> float:
        value = self.content.provenance.get(name)
        return float(value) if isinstance(value, int | float) else math.nan

    def _describe(self) -> tuple[str, Facts]:
        content = self.content
        facts = [
            ("created", content.created),
            ("3-D RMS", _um(self.rms_um)),
            ("held-out 3-D RMS", _um(self.heldout_rms_um)),
            ("identified quantities", str(len(content.covariance_of))),
            ("terms", str(len(content.terms))),
            ("SHA-256", self.sha256[:16]),
        ]
        ranges = content.temperature_range_c.values()
        if ranges:
            low, high = min(r[0] for r in ranges), max(r[1] for r in ranges)
            facts.insert(3, ("temperatures", f"{low:.1f} to {high:.1f} °C"))
        if self.identified is not None:
            facts += [("note", note) for note in self.identified.result.notes]
            facts.append(("certificate", self.identified.result.certificate.in_words()))
        return f"Calibration of arm {content.arm}", facts


def _um(value: float) -> str:
    return "not recorded" if math.isnan(value) else f"{value:.2f} µm"


def read_calibration(path: PathText) -> Calibration:
    """Read and check a calibration file.

    Functions that take a calibration and an arm check whether they belong together.
    Raises `armd.BadInput` for a malformed file, or content that does not match its hash.

    >>> calibration = armd.read_calibration("calibration.json")
    >>> calibration.parameters["name"][0]
    np.str_('theta_1')
    """
    return Calibration(load_calibration(Path(path)))


def convert_calibration(content: Content, identified: Identified | None = None) -> Calibration:
    """Return the calibration that `read_calibration` would read from a file of *content*."""
    loaded = save_calibration("calibration", content, write=lambda _path, _data: None)
    return Calibration(loaded, identified)


def resolve_calibration(
    calibration: Calibration | PathText | None, arm: ArmModel
) -> LoadedCalibration | None:
    """Return the calibration, read if it is a path; raises `BadInput` for another arm."""
    if calibration is None:
        return None
    read = calibration if isinstance(calibration, Calibration) else read_calibration(calibration)
    return read.for_arm(arm.content)
