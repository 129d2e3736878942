"""The arm.toml of a MicroScribe, from the data in its memory that the factory wrote."""

from __future__ import annotations

from armd.drivers.microscribe.factory import Factory
from armd.drivers.microscribe.geometry import compute_rows_and_tip
from armd.errors import BadInput


def write_arm_text(factory: Factory, port: str, ball: bool) -> str:
    """Return the arm.toml; raises `BadInput` for geometry in an unknown form."""
    try:
        rows, tip = compute_rows_and_tip(factory.parameters, factory.beta, ball)
    except ValueError as error:
        raise BadInput(
            port, "the arm's parameters", str(error), "the maker's form DH0.5"
        ) from error
    lines = [
        f"# MicroScribe {factory.model}, serial number {factory.serial_number}, five joints.",
        "# The factory's geometry, read from the arm's own memory "
        f"({factory.format}, firmware {factory.firmware}).",
        "# Source: this very arm. Licence: none needed, these are its measurements.",
        f"# The tip is the {'ball' if ball else 'point'}'s. No temperature is measured.",
        "# Angles hold only after homing: press a pedal with the stylus in its rest.",
        "",
        'schema = "armd.arm/1"',
        f'serial_number = "{factory.serial_number}"',
        "reference_temperature_c = 20.0",
    ]
    for row, turn in zip(rows, factory.counts_per_turn, strict=True):
        lines += [
            "",
            "[[joint]]",
            "theta_deg = 0.0",
            f"d_mm = {row.d_mm:.9g}",
            f"a_mm = {row.a_mm:.9g}",
            f"alpha_deg = {row.alpha_deg!r}",
            f"beta_deg = {row.beta_deg!r}",
            f"counts_per_turn = {turn}",
            "direction = 1",
        ]
    offset = ", ".join(f"{x:.9g}" for x in tip)
    return "\n".join([*lines, "", "[tip]", f"offset_mm = [{offset}]", "radius_mm = 0.0", ""])


def write_daemon_text(arm_file: str, port: str, baud: int) -> str:
    """Return an armd.toml that runs the arm."""
    return f"""\
schema = "armd.daemon/1"
arm = "{arm_file}"

[driver]
kind = "microscribe"
port = "{port}"
baud = {baud}
"""
