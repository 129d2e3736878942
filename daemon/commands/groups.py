"""The table of commands by the groups of `armd --help`: action and folder of each."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping

#: Heading of `armd --help` → name of a command (and its module) → folder of
#: `armd.daemon.commands`, and what the command does: a verb and its object.
GROUPS: dict[str, dict[str, tuple[str, str]]] = {
    "try": {
        "demo": ("service", "run a simulated arm, live; needs no hardware"),
        "simulate": ("service", "simulate an arm on a wire, or whole measuring sessions"),
    },
    "connect": {
        "init": ("setup", "write a folder with arm.toml and armd.toml to start from"),
        "arm": ("setup", "describe an arm that armd knows: SO-101, MicroScribe and others"),
        "doctor": ("setup", "find connected devices, and what stands in the way"),
        "run": ("service", "run the daemon: read an arm, correct, publish points"),
        "accept": ("service", "accept the servos' offsets found last as the arm's own"),
        "reload": ("live", "reload the calibration of a running daemon"),
        "status": ("live", "show the state of a running daemon, for people and scripts"),
        "fleet": ("live", "list all reachable arms: state, rate, lost, calibration"),
    },
    "measure": {
        "watch": ("live", "show an arm's points in the terminal, live"),
        "view": ("live", "serve the page that shows the arm live in a browser"),
        "measure": ("live", "guide a measurement to its calibration or certificate"),
        "tip": ("live", "list, use, calibrate and apply tips"),
        "feature": ("offline", "fit lines, planes, circles and others to measurements"),
        "record": ("live", "record frames, samples and points to a file or a lake"),
        "replay": ("service", "play a recording back through decoder and kernel"),
    },
    "calibrate and judge": {
        "design": ("offline", "choose the poses to measure first or next"),
        "calibrate": ("offline", "identify geometry and thermal model from sessions"),
        "evaluate": ("offline", "compute residuals of sessions under a model"),
        "verify": ("offline", "judge an arm by ISO 10360-12 and ASME B89.4.22"),
        "diagnose": ("offline", "find what the model gets wrong, why, and the gain"),
        "interim": ("offline", "watch an arm by short checks: changed, when, and why"),
        "correct": ("offline", "correct a table of readings, with the daemon's kernel"),
        "recorrect": ("offline", "correct old measurements with a later calibration"),
    },
    "other software": {
        "ippdme": ("live", "serve inspection software over I++ DME"),
        "ros2": ("live", "publish ROS 2 topics, without ROS on the controller"),
        "stream": ("live", "send text lines over TCP: one per measurement or point"),
        "export": ("live", "write measurements as CSV, XYZ, PLY, QIF; recordings as MCAP"),
        "model": ("offline", "write the geometry as URDF, default_kinematics.yaml, table"),
        "compensate": ("offline", "compute joint angles that bring the real tip to a place"),
    },
    "files": {
        "import": ("setup", "make a session of a table, or an arm.toml of a URDF"),
        "check": ("setup", "check any armd file"),
        "schema": ("setup", "print JSON schemas of armd's files, for an editor"),
        "completion": ("setup", "print completion for bash, zsh or fish"),
        "man": ("setup", "print this help as a man page"),
    },
}
#: Name of a command → what it does.
COMMANDS = {name: line for group in GROUPS.values() for name, (_, line) in group.items()}
#: Name of a command → folder of `armd.daemon.commands`.
FOLDERS = {name: folder for group in GROUPS.values() for name, (folder, _) in group.items()}


def format_grouped_help(added: Mapping[str, str]) -> str:
    """List all commands under their headings, then those that other packages *added*."""
    groups = {title: {name: COMMANDS[name] for name in names} for title, names in GROUPS.items()}
    if added:
        groups["of other packages"] = dict(added)
    return "\n\n".join(
        f"{title}:\n" + "\n".join(_make_rows(group)) for title, group in groups.items()
    )


def _make_rows(group: Mapping[str, str]) -> Iterator[str]:
    for name, line in group.items():
        yield textwrap.fill(line, 79, initial_indent=f"  {name:<11} ", subsequent_indent=" " * 14)
