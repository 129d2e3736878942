"""Files that people give to the commands, each with its damaged turn."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from fuzz.doors import Door, command
from fuzz.messages import WHOLE

from armd.compensation.model.calibration import hash_content
from armd.daemon.bridges.ros2 import urdf
from armd.files.toml_text import format_toml
from support.small_arm_toml import ARM, CALIBRATION

FIELD = Path(__file__).parents[1] / "field"
URDF = Path(__file__).parents[1] / "real" / "data" / "ball_in_socket" / "urdf" / "gen3lite.urdf"
SESSION = {
    "schema": "armd.session/1", "arm": "SMALL-1", "started": "2026-03-01T09:00:00Z",
    "angle_unit": "rad",
    "artefact": {"name": "seats", "target": [{"name": "S1"}, {"name": "S2"}],
                 "distance": [{"between": ["S1", "S2"], "length_mm": 200.0}]},
}  # fmt: skip
DAEMON = """schema = "armd.daemon/1"
arm = "arm.toml"
calibration = "cal.json"
[driver]
kind = "serial"
port = "/dev/null"
[tips.ruby]
offset_mm = [0.0, 0.0, 120.0]
"""
MPE = """schema = "armd.mpe/1"
p_form_sph_um = 30.0
"""


def table() -> bytes:
    rng = np.random.default_rng(1)
    rows = ["time_s,placement,target,q1,q2,q3,t1"]
    for k in range(16):
        q = rng.uniform(-1.0, 1.0, 3)
        rows.append(
            f"{k * 7},{k // 8 + 1},S{k % 2 + 1}," + ",".join(f"{x:.6f}" for x in q) + ",21.5"
        )
    return ("\n".join(rows) + "\n").encode()


def sheet(rows: bytes) -> bytes:
    from openpyxl import Workbook

    book = Workbook()
    for line in rows.decode().splitlines():
        book.active.append([float(x) if x[:1].isdigit() else x for x in line.split(",")])
    data = io.BytesIO()
    book.save(data)
    return data.getvalue()


def parquet(rows: bytes) -> bytes:
    import pyarrow.csv
    import pyarrow.parquet

    data = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.csv.read_csv(io.BytesIO(rows)), data)
    return data.getvalue()


def sealed(data: bytes) -> bytes:
    """A damaged calibration with the hash of what it has become, as whoever edits one on purpose
    would write it; what is no JSON stays as it is."""
    try:
        content = json.loads(data)
        content["content_sha256"] = hash_content(content)
        return json.dumps(content).encode()
    except (ValueError, TypeError, RecursionError, AttributeError):
        return data


def file_doors(folder: Path) -> Iterator[Door]:
    """The folder is filled with one sound file of each kind."""
    session = folder / "s"
    session.mkdir(parents=True)
    arm = ARM | {"temperature_sensor": [{"name": "t1"}]}
    contents = {
        "arm.toml": format_toml(arm).encode(),
        "armd.toml": DAEMON.encode(),
        "cal.json": sealed(json.dumps(CALIBRATION).encode()),
        "mpe.toml": MPE.encode(),
        "s/session.toml": format_toml(SESSION).encode(),
        "s/readings.csv": table(),
        "table.csv": table(),
        "table.xlsx": sheet(table()),
        "table.parquet": parquet(table()),
        "arm.urdf": URDF.read_bytes(),
        "like.urdf": urdf.write({"arm": ARM}, None, "S", "S_base").encode(),
        "lerobot.json": (FIELD / "lerobot-wrapped-sweep" / "whole.json").read_bytes(),
        "rows.csv": b"theta,d,a,alpha\n0,200,300,90\n0,0,300,0\n0,0,300,-90\n",
        "m.jsonl": b"".join(
            json.dumps(WHOLE | {"seq": k, "stamp_ns": 10**18 + k, "angles_rad": [0.1, 0.2, 0.3],
                                "tip": None}).encode() + b"\n"
            for k in range(4)
        ),
    }  # fmt: skip
    for name, content in contents.items():
        (folder / name).write_bytes(content)

    def door(name: str, file: str, *words: str) -> Door:
        return command(folder, name, file, contents[file], *words)

    for file in ("arm.toml", "armd.toml", "cal.json", "mpe.toml"):
        yield door(f"check {file}", file, "check", f"@{file}")
    for file in ("s/session.toml", "s/readings.csv", "arm.toml", "cal.json"):
        yield door(f"check session, {file}", file, "check", "@arm.toml", "@cal.json", "@s")
    for file in ("arm.toml", "s/session.toml", "s/readings.csv", "cal.json"):
        yield door(f"evaluate, {file}", file, "evaluate", "@s", "--arm", "@arm.toml",
                   "--calibration", "@cal.json", "--json", "@out.json")  # fmt: skip
    for file in ("table.csv", "table.parquet", "arm.toml", "cal.json"):
        source = file if file.startswith("table") else "table.csv"
        yield door(f"correct, {file}", file, "correct", f"@{source}", "--arm", "@arm.toml",
                   "--calibration", "@cal.json", "-o", "@out.csv")  # fmt: skip
    for file in ("table.csv", "table.xlsx"):
        yield door(f"import {file}", file, "import", f"@{file}", "--arm", "@arm.toml", "-o", "@out")
    yield door("import urdf", "arm.urdf", "import", "@arm.urdf", "--tip-link", "ball_link",
               "-o", "@out.toml")  # fmt: skip
    yield door("model like urdf", "like.urdf", "model", "@arm.toml", "--calibration", "@cal.json",
               "--like", "@like.urdf", "-o", "@out.urdf")  # fmt: skip
    yield door("compensate", "table.csv", "compensate", "@table.csv", "--arm", "@arm.toml",
               "--calibration", "@cal.json", "-o", "@out.csv")  # fmt: skip
    yield door("import-lerobot", "lerobot.json", "arm", "import-lerobot", "@lerobot.json",
               "-o", "@out.toml", "--arm", "so101")  # fmt: skip
    yield door("init", "rows.csv", "init", "@out", "--from", "@rows.csv", "--serial-number",
               "M")  # fmt: skip
    term = {"parameter": "theta_2", "coefficient": 1e-5,
            "basis": [{"kind": "sin", "joint": 2, "order": 1}]}  # fmt: skip
    extended = CALIBRATION | {
        "terms": [term], "covariance_of": ["theta_1", "term 0"],
        "covariance": [[1e-12, 0.0], [0.0, 1e-14]], "temperature_range_c": {"t1": [15.0, 30.0]},
    }  # fmt: skip
    seed = sealed(json.dumps(extended).encode())
    for words in (
        ("check", "@arm.toml", "@cal.json"),
        ("correct", "@table.csv", "--arm", "@arm.toml", "--calibration", "@cal.json",
         "-o", "@out.csv"),
        ("evaluate", "@s", "--arm", "@arm.toml", "--calibration", "@cal.json"),
    ):  # fmt: skip
        plain = command(folder, f"{words[0]}, sealed", "cal.json", contents["cal.json"], *words)
        yield Door(plain.name, [seed], lambda data, enter=plain.enter: enter(sealed(data)))
    for suffix in ("csv", "qif", "ply"):
        yield door(f"export to {suffix}", "m.jsonl", "export", "@m.jsonl", "-o", f"@out.{suffix}")
    yield door("recorrect", "m.jsonl", "recorrect", "@m.jsonl", "--arm", "@arm.toml",
               "--calibration", "@cal.json", "-o", "@out.csv")  # fmt: skip
