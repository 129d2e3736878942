"""Names of columns in tables, in small letters: one list for readings and for joints.

A header is a word and a unit: `Joint 1 [deg]`, `q1_deg`, `actual_q[0]`, `T (°C)`.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

#: The unit of a session, and the factor to it.
ANGLES: dict[str, tuple[str, float]] = {
    **dict.fromkeys(("deg", "degs", "°", "degree", "degrees"), ("deg", 1.0)),
    **dict.fromkeys(("rad", "rads", "radian", "radians"), ("rad", 1.0)),
    **dict.fromkeys(("count", "counts", "inc", "ticks", "lsb"), ("count", 1.0)),
    **dict.fromkeys(("mdeg", "m°"), ("deg", 1e-3)),
    "mrad": ("rad", 1e-3),
    **dict.fromkeys(("rev", "revs", "turn", "turns"), ("deg", 360.0)),
    "gon": ("deg", 0.9),
    "arcmin": ("deg", 1 / 60),
    "arcsec": ("deg", 1 / 3600),
}
LENGTHS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "µm": 1e-3, "μm": 1e-3}
LENGTHS |= dict.fromkeys(("in", "inch", "inches", '"'), 25.4)
TIMES = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    "ms": 1e-3,
    **dict.fromkeys(("us", "µs", "μs"), 1e-6),
    "ns": 1e-9,
    "min": 60.0,
    "h": 3600.0,
}
#: The factor to °C, and the number that is added afterwards.
TEMPERATURES = {
    **dict.fromkeys(("c", "°c", "degc", "celsius", "℃"), (1.0, 0.0)),
    **dict.fromkeys(("f", "°f", "degf", "fahrenheit"), (5 / 9, -160 / 9)),
    **dict.fromkeys(("k", "kelvin"), (1.0, -273.15)),
}
#: Factors to the first unit, which is that of a session.
RATES = {
    "rad/s": 1.0,
    **dict.fromkeys(("deg/s", "°/s"), math.pi / 180),
    **dict.fromkeys(("rpm", "1/min", "rev/min"), math.tau / 60),
}
#: Units of plain numbers; "grad" is not listed: a degree in German, 0.9 of one elsewhere.
UNITLESS = ("-", "1", "none", "n/a", "[]", "unitless")
UNITS = {*ANGLES, *LENGTHS, *TIMES, *TEMPERATURES, *RATES}

#: Cells that mean a missing value.
MISSING = (
    "", "nan", "na", "n/a", "n.a.", "-", "--", "–", "—", "null", "none", "#n/a", "#nv", "#n/v",
    "<na>", "nat",
)  # fmt: skip

Kind = Literal["angle", "rate", "temperature"]

JOINT = ("joint", "axis", "link", "achse", "gelenk", "j", "a")
ANGLE = ("q", "theta", "angle", "winkel", "position", "pos", "encoder", "enc")
RATE = ("w", "rate", "speed", "omega", "dq", "qd", "velocity", "vel", "qdot", "dot")
TEMPERATURE = ("t", "temp", "temps", "temperature", "temperatures", "temperatur")
MOTOR = ("motor", "servo", "actuator", "drive", "sensor")
MEASURED = (
    "actual", "measured", "meas", "present", "current", "feedback", "observation", "state", "ist",
)  # fmt: skip
COMMANDED = (
    "target", "commanded", "command", "cmd", "desired", "goal", "action", "setpoint", "ref", "soll",
)  # fmt: skip
_KINDS = {
    **dict.fromkeys((*JOINT, *ANGLE), "angle"), **dict.fromkeys(RATE, "rate"),
    **dict.fromkeys(TEMPERATURE, "temperature"), **dict.fromkeys(MOTOR, "motor"),
    **dict.fromkeys(MEASURED, "measured"), **dict.fromkeys(COMMANDED, "commanded"),
}  # fmt: skip
_PART = "|".join(sorted(map(re.escape, _KINDS), key=len, reverse=True))
_PARTS = re.compile(f"(?:{_PART})*")

#: The names that a table with a row per joint uses for a joint's key in arm.toml.
OF_A_JOINT = {
    "theta_deg": ("theta", "angle", "jointangle", "q", "winkel"),
    "d_mm": ("d", "linkoffset", "jointdistance"),
    "a_mm": ("a", "r", "length", "linklength"),
    "alpha_deg": ("alpha", "twist", "linktwist", "twistangle"),
    "beta_deg": ("beta",),
    "min_deg": ("min", "minangle", "lower", "lowerlimit", "qmin", "minimum"),
    "max_deg": ("max", "maxangle", "upper", "upperlimit", "qmax", "maximum"),
    "counts_per_turn": ("countsperturn", "countsperrev", "countsperrevolution", "cpr", "counts"),
    "temperature": (*TEMPERATURE[1:], "sensor"),
}
#: Names of a column that only numbers the joints.
NUMBERS = (
    "", "no", "nr", "number", "i", "k", "n", "row", "name", "frame", "joints", *JOINT[:-1],
    "jointno", "linkno", "jointname",
)  # fmt: skip
GREEK = str.maketrans({"θ": "theta", "ϑ": "theta", "α": "alpha", "β": "beta", "ω": "omega"})

#: Names that one column of a table of readings may have.
TIME = (
    "time", "t", "zeit", "seconds", "timestamp", "stamp", "elapsed", "elapsedtime", "epoch",
    "unixtime", "unix", "datetime", "dateandtime", "zeitstempel", "times",
)  # fmt: skip
DATE = ("date", "datum", "day")
WORDS = {
    **dict.fromkeys(TIME, "time_s"),
    **dict.fromkeys(("pose", "setup", "aufstellung", "placement"), "placement"),
    **dict.fromkeys(
        ("ball", "sphere", "point", "seat", "hole", "kugel", "punkt", "name", "target", "nest",
         "kugelname", "punktname", "pointname", "targetname"), "target",
    ),
    "x": "x_mm", "y": "y_mm", "z": "z_mm", "reflector": "reflector",
    **dict.fromkeys(
        (f"{thing}{word}" for thing in ("artefact", "artifact", "part")
         for word in ("", "temp", "temperature") if thing + word != "part"), "artefact_c",
    ),
}  # fmt: skip

#: Joint names of known arms, base to wrist: LeRobot's, Universal Robots', Interbotix's.
NAMED_JOINTS = (
    ("shoulderpan", "shoulderlift", "elbowflex", "wristflex", "wristroll"),
    ("shoulderpan", "shoulderlift", "elbow", "wrist1", "wrist2", "wrist3"),
    ("waist", "shoulder", "elbow", "forearmroll", "wristangle", "wristrotate"),
)
_AROUND_NAMES = re.compile(
    r"^(?:observationstate|main|follower|leader|arm|left|right)*(.*?)"
    r"(?:joint)?(?:pos|position|angle)?$"
)


@dataclass(frozen=True)
class Numbered:
    """The meaning of a header such as `actual_q_0`: quantity, number of joint or sensor, and
    family.
    """

    kind: Kind
    number: int
    family: str  # the header without its number; one family has one numbering


def split_unit(header: str) -> tuple[str, str]:
    """Split a header such as `Joint 1 [deg]`, `q1_deg` or `X (in)` into a bare word and a unit.

    Both are in small letters.
    """
    text = header.translate(GREEK).lower().strip()
    *words, last = re.split(r"[ _.]+", text)
    unit = ""
    if words and last in UNITS:
        text, unit = " ".join(words), last
    elif bracketed := re.fullmatch(r"(.*?)[\[(/]\s*([^\])]*?)\s*[\])]?", text):
        if bracketed[2].isdigit():  # q[0]
            text = f"{bracketed[1]}{bracketed[2]}"
        else:
            text, unit = bracketed[1], bracketed[2]
    return re.sub(r"[^a-zäöü0-9]", "", text), unit


def parse_numbered(word: str) -> Numbered | None:
    """Return the meaning of a bare *word* that numbers a joint or sensor; None for any
    other word.
    """
    parts = re.fullmatch(r"([a-zäöü]*?)(\d{1,3})([a-zäöü]*)", word)  # no arm has a thousand
    if parts is None or not parts[1] + parts[3]:
        return None
    kinds: list[str] = []
    for letters in (parts[1], parts[3]):
        if not _PARTS.fullmatch(letters):
            return None
        kinds += [_KINDS[part] for part in re.findall(_PART, letters)]
    if "commanded" in kinds or parts[3] in (*JOINT[-2:], "t", "w"):
        return None
    kind: Kind
    if "temperature" in kinds:
        kind = "temperature"
    elif "rate" in kinds:
        kind = "rate"
    elif "angle" in kinds:
        kind = "angle"
    else:
        return None
    return Numbered(kind, int(parts[2]), f"{parts[1]}#{parts[3]}")


def find_joint_name(header: str) -> str:
    """Return the joint's name in a header: `observation.state.shoulder_pan.pos` gives
    `shoulderpan`.

    A header without such a name is returned as a bare word.
    """
    word, _ = split_unit(header)
    bare = _AROUND_NAMES.fullmatch(word)
    return bare[1] if bare else word


def drop_temperature(word: str) -> str:
    """Drop the word for temperature: `servo2temp` and `tempservo2` give `servo2`."""
    for part in sorted(TEMPERATURE[1:], key=len, reverse=True):
        if word.removeprefix(part) != word or word.removesuffix(part) != word:
            return word.removeprefix(part).removesuffix(part)
    return word
