"""Measurements as QIF 3.0 Results (ANSI/QIF 3.0, ISO 23952), one measured point each.

Elements and their order are those of QIFDocument.xsd, QIFResults.xsd and Features.xsd
(`PointFeatureMeasurementType`): feature name, time stamp, device, location, normal.
"""

from __future__ import annotations

import datetime
import math
import uuid
from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from armd import __version__
from armd.daemon.bridges.export.source import MeasurementLine
from armd.daemon.bridges.export.tables import compute_direction, compute_uncertainty_mm
from armd.daemon.bridges.tips import Tips

NAMESPACE = "http://qifstandards.org/xsd/qif3"
DEVICE_ID, RESULTS_ID, FIRST_POINT_ID = 1, 2, 3


def as_qif(measurements: Sequence[MeasurementLine], tips: Tips, serial: str) -> str:
    """Return a QIF document with every measurement that has a position (mm, base frame).

    Combined standard uncertainties are written where they are known. The inspection's status is
    UNKNOWN, because nothing was judged.
    """
    points = [m for m in measurements if m.position_mm is not None]
    last_id = FIRST_POINT_ID + len(points) - 1
    document = Element("QIFDocument", xmlns=NAMESPACE, versionQIF="3.0.0", idMax=str(last_id))
    _text(document, "QPId", str(uuid.uuid4()))
    header = SubElement(document, "Header")
    application = SubElement(header, "Application")
    _text(application, "Name", f"armd {__version__}")
    _text(application, "Organization", "armd")
    _units(document)
    resources = SubElement(document, "MeasurementResources")
    devices = SubElement(resources, "MeasurementDevices", n="1")
    device = SubElement(devices, "MeasurementDevice", id=str(DEVICE_ID))
    _text(device, "Name", f"articulated arm {serial}".strip())
    results = SubElement(SubElement(document, "Results"), "MeasurementResultsSet", n="1")
    result = SubElement(results, "MeasurementResults", id=str(RESULTS_ID))
    if points:
        features = SubElement(result, "MeasuredFeatures", n=str(len(points)))
        for number, m in enumerate(points):
            _point(features, FIRST_POINT_ID + number, number + 1, m, tips)
    _text(SubElement(result, "InspectionStatus"), "InspectionStatusEnum", "UNKNOWN")
    indent(document)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(document, "unicode") + "\n"


def _units(document: Element) -> None:
    unit = SubElement(SubElement(SubElement(document, "FileUnits"), "PrimaryUnits"), "LinearUnit")
    _text(unit, "SIUnitName", "meter")
    _text(unit, "UnitName", "mm")
    _text(SubElement(unit, "UnitConversion"), "Factor", "0.001")


def _point(features: Element, identity: int, number: int, m: MeasurementLine, tips: Tips) -> None:
    feature = SubElement(features, "PointFeatureMeasurement", id=str(identity))
    _text(feature, "FeatureName", f"PNT{number}")
    _text(feature, "TimeStamp", _instant(m.stamp_ns))
    _text(SubElement(feature, "MeasurementDeviceIds", n="1"), "Id", str(DEVICE_ID))
    assert m.position_mm is not None
    location = _text(feature, "Location", " ".join(f"{x:.6f}" for x in m.position_mm))
    u = compute_uncertainty_mm(m)
    if not math.isnan(u[0]):
        location.set("combinedUncertainty", f"{math.hypot(*u):.6f}")
        for axis, value in zip("xyz", u, strict=True):
            location.set(f"{axis}CombinedUncertainty", f"{value:.6f}")
    normal = compute_direction(m, tips)
    if not math.isnan(normal[0]):
        _text(feature, "Normal", " ".join(f"{x:.9f}" for x in normal))


def _instant(stamp_ns: int) -> str:
    """Format an instant as xs:dateTime, in UTC, to the nanosecond."""
    second = datetime.datetime.fromtimestamp(stamp_ns // 10**9, datetime.UTC)
    return f"{second:%Y-%m-%dT%H:%M:%S}.{stamp_ns % 10**9:09d}Z"


def _text(parent: Element, name: str, text: str) -> Element:
    element = SubElement(parent, name)
    element.text = text
    return element
