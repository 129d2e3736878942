"""Events about a node for the user: it warns, has failed, or is back."""

from __future__ import annotations

from typing import Any

from armd.drivers.can import objects as can
from armd.drivers.can.node import Node
from armd.drivers.sample import Event


def report_warnings(node: Node, now_ns: int) -> Event:
    """Return the event of changed `warnings` of *node*."""
    detail = {"joint": node.number, "warnings": node.warnings}
    if not node.warnings:
        return Event("joint_warning", f"{node.name} warns no more", now_ns, "info", detail)
    text = f"{node.name}: its encoder warns ({node.warnings:#06x}); its position still holds"
    return Event("joint_warning", text, now_ns, "warning", detail)


def report_limits(
    node: Node, nameless: bool, counts_told: bool, alarms: int | None, now_ns: int
) -> Event:
    """Return the event of the objects that an encoder lacks.

    *nameless*: it has no serial number; *counts_told*: it reports its counts per turn; *alarms*:
    its answer when it was asked for them by SDO.
    """
    lacks = []
    if nameless:
        lacks.append("no serial number (1018:4): another encoder in its place goes unnoticed")
    if not counts_told:
        unchecked = f"the {node.counts_per_turn} of arm.toml are taken unchecked"
        lacks.append(f"no counts per turn (6501): {unchecked}")
    if node.layout.alarms_at is None:
        how = "asked for by SDO instead" if alarms is not None else "not to be had by SDO either"
        lacks.append(f"no room for its alarms (6503) in TPDO1: they are {how}")
    text = f"{node.name}: its encoder has {' and '.join(lacks)}"
    detail = {"joint": node.number, "lacks": lacks}
    return Event("encoder_limited", text, now_ns, "info", detail)


def report_failure(node: Node, fault: str, now_ns: int) -> Event:
    detail: dict[str, Any] = {"node": node.number, "reason": fault}
    kind = "sensors_lost"
    if node.number not in can.TEMPERATURE_NODES:
        detail["joint"] = node.number
        kind = "joint_invalid"
    return Event(kind, f"{node.name}: {fault}", now_ns, "error", detail)


def report_recovery(node: Node, fault: str, now_ns: int) -> Event:
    """Return the event of a node that reports again after *fault*."""
    kind = "sensors_valid" if node.number in can.TEMPERATURE_NODES else "joint_valid"
    detail = {"node": node.number, "joint": node.number}
    text = f"{node.name} is configured again and reports ({fault})"
    return Event(kind, text, now_ns, "info", detail)
