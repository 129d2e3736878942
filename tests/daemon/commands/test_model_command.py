"""`armd model`: what other software makes of each file has its tip where armd has it."""

from __future__ import annotations

import csv
import json
import math
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np
import pytest

from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.calibration import Calibration, save_calibration
from armd.daemon.catalogue.urdf.urdf import compute_denavit_hartenberg, read_chain
from armd.daemon.cli import main
from armd.files.toml_text import format_toml
from support.drawn import drawn
from support.own_urdf import OWN
from support.plain_kinematics import rotation, tip_pose, translation
from support.plain_urdf import tip_poses
from support.selection import parametrize_default

UR5E = [(162.5, 0, 90), (0, -425, 0), (0, -392.2, 0), (133.3, 0, 90), (99.7, 0, -90), (99.6, 0, 0)]
EXACT_MM, EXACT_RAD = 1e-6, 1e-9


def calibrate(folder: Path, arm: Arm, terms: list[dict[str, Any]] | None = None) -> np.ndarray:
    """Writes cal.json, every parameter off its drawing; the constants."""
    rng = np.random.default_rng(5)
    values, layout = arm.nominal(), arm.layout
    values += np.where(layout.are_lengths, 1.0, 4e-3) * rng.normal(size=layout.count)
    calibration = drawn(
        arm, values=values, terms=terms or [],
        temperature_range_c={"t1": (15.0, 25.0)} if terms else {},
        covariance_of=["theta_2", "a_2", *(["term 0"] if terms else [])],
        covariance=np.diag([1e-10, 1e-4, 1e-6][: 3 if terms else 2]).tolist(),
    )  # fmt: skip
    save_calibration(folder / "cal.json", calibration)
    return values


def own(folder: Path) -> tuple[Path, Arm]:
    (folder / "own.urdf").write_text(OWN)
    into = ["-o", str(folder / "arm.toml")]
    assert main(["import", str(folder / "own.urdf"), "--tip-link", "tool0", *into]) == 0
    return folder / "own.urdf", load_arm(folder / "arm.toml")


def ur(folder: Path) -> Arm:
    joints = [
        {"d_mm": float(d), "a_mm": float(a), "alpha_deg": float(alpha), "temperature": "t1",
         "min_deg": -170.0, "max_deg": 170.0}
        for d, a, alpha in UR5E
    ]  # fmt: skip
    content = {
        "schema": "armd.arm/1", "serial_number": "UR-1", "temperature_sensor": [{"name": "t1"}],
        "joint": joints, "tip": {"offset_mm": [3.0, 0.0, 80.0], "radius_mm": 1.0},
    }  # fmt: skip
    (folder / "arm.toml").write_text(format_toml(content))
    return load_arm(folder / "arm.toml")


def model(folder: Path, output: str, *options: object, calibrated: bool = True) -> int:
    given = ["--calibration", str(folder / "cal.json")] if calibrated else []
    words = [str(folder / "arm.toml"), *given, "-o", str(folder / output), *map(str, options)]
    return main(["model", *words])


def postures(arm: Arm, n: int = 1000) -> np.ndarray:
    rng = np.random.default_rng(8)
    return np.vstack([np.zeros(arm.n_joints), rng.uniform(*arm.range_rad, (n, arm.n_joints))])


def assert_same(one: np.ndarray, other: np.ndarray) -> None:
    """Poses (n, 4, 4), mm."""
    assert np.linalg.norm(one[:, :3, 3] - other[:, :3, 3], axis=1).max() < EXACT_MM
    chord = np.linalg.norm(one[:, :3, :3] - other[:, :3, :3], axis=(1, 2))
    assert chord.max() / math.sqrt(2) < EXACT_RAD


def expected_tip(path: Path, arm: Arm, values: np.ndarray, base: str | None = None) -> np.ndarray:
    """armd's tip in the base link, as import places it; turned as the tip's link is as drawn."""
    link = read_chain(path, "tool0", base)
    placed = np.eye(4)
    placed[:3, :3], placed[:3, 3] = compute_denavit_hartenberg(link)[2], link.origins[0]
    zero = np.zeros((1, arm.n_joints))
    drawn = placed @ tip_pose(zero, arm.nominal()[None])[0]
    turned = np.eye(4)
    link_at_zero = tip_poses(Xml.fromstring(path.read_text()), zero, "tool0", base)[0]
    turned[:3, :3] = drawn[:3, :3].T @ link_at_zero[:3, :3]
    q = postures(arm)
    return placed @ tip_pose(q, np.tile(values, (len(q), 1))) @ turned


def without_numbers(text: str) -> str:
    """The file without origins and axes, and without the space that one put in brings."""
    return re.sub(r"\s*<(origin|axis)\b[^>]*/>", "", text)


@pytest.mark.parametrize("links", [(), ("--base-link", "base")])
def test_a_persons_own_urdf_has_the_calibrated_tip(tmp_path: Path, links: tuple[str, ...]) -> None:
    path, arm = own(tmp_path)
    values = calibrate(tmp_path, arm)
    assert model(tmp_path, "new.urdf", "--like", path, "--tip-link", "tool0", *links) == 0
    text = (tmp_path / "new.urdf").read_text()
    base = links[1] if links else None
    found = tip_poses(Xml.fromstring(text), postures(arm), "tool0", base)
    before = expected_tip(path, arm, values)
    if base is not None:  # arm.toml is of the chain from the root
        stand = tip_poses(Xml.fromstring(OWN), np.zeros((1, 0)), "base")[0]
        before = np.linalg.inv(stand) @ before
    assert_same(found, before)


def test_nothing_else_of_the_file_changes(tmp_path: Path) -> None:
    path, arm = own(tmp_path)
    calibrate(tmp_path, arm)
    assert model(tmp_path, "new.urdf", "--like", path, "--tip-link", "tool0") == 0
    text = (tmp_path / "new.urdf").read_text()
    assert without_numbers(text) == without_numbers(OWN)
    old, new = Xml.fromstring(OWN), Xml.fromstring(text)
    kept = ["cover", "finger", "other_finger"]
    for joint, again in zip(old.findall("joint"), new.findall("joint"), strict=True):
        axis = [None if (a := j.find("axis")) is None else a.attrib for j in (joint, again)]
        assert axis[0] == axis[1]
        if joint.get("name") in kept:
            assert Xml.tostring(joint) == Xml.tostring(again)
    for part in ("rpy='0 0 0.4' xyz='0.2 0 0.75'", '<origin xyz="9 9 9"/>', '"1 2 3"', "\trpy="):
        assert part in text
    assert re.search(r'<origin xyz="[^"]*" quat_xyzw="[^"]*"/>', text)


def test_the_drawing_leaves_the_file_as_it_is(tmp_path: Path) -> None:
    path, _ = own(tmp_path)
    options = ("--like", path, "--tip-link", "tool0")
    assert model(tmp_path, "new.urdf", *options, calibrated=False) == 0
    assert (tmp_path / "new.urdf").read_bytes() == path.read_bytes()


def test_a_new_urdf_and_then_one_like_it(tmp_path: Path) -> None:
    arm = ur(tmp_path)
    values = calibrate(tmp_path, arm)
    q = postures(arm)
    wanted = tip_pose(q, np.tile(values, (len(q), 1)))
    assert model(tmp_path, "new.urdf") == 0
    assert_same(tip_poses(Xml.parse(tmp_path / "new.urdf").getroot(), q, "UR_1_ball"), wanted)
    assert model(tmp_path, "drawn.urdf", calibrated=False) == 0
    assert model(tmp_path, "like.urdf", "--like", tmp_path / "drawn.urdf") == 0
    assert_same(tip_poses(Xml.parse(tmp_path / "like.urdf").getroot(), q, "UR_1_ball"), wanted)


def test_universal_robots_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Read as ur_description does: x, y, z, roll, pitch, yaw, then a turn about z."""
    arm = ur(tmp_path)
    values = calibrate(tmp_path, arm)
    assert model(tmp_path, "default_kinematics.yaml") == 0
    told = capsys.readouterr().out
    for name in ("a_6", "alpha_6", "beta_6", "tip_x", "tip_z"):
        assert f"{name} = " in told
    text = (tmp_path / "default_kinematics.yaml").read_text()
    links = re.findall(r"  (\w+):\n((?:    \w+: \S+\n)+)", text)
    assert [name for name, _ in links] == [
        "shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3",
    ]  # fmt: skip
    assert re.search(r"^  hash: \w+$", text, re.MULTILINE)
    q = postures(arm)
    poses = np.tile(np.eye(4), (len(q), 1, 1))
    for (_, block), angle in zip(links, q.T, strict=True):
        v = {key: float(value) for key, value in re.findall(r"(\w+): (\S+)", block)}
        way = translation(1e3 * np.array([v["x"], v["y"], v["z"]]))
        turn = rotation(2, v["yaw"]) @ rotation(1, v["pitch"]) @ rotation(0, v["roll"])
        poses = poses @ way @ turn @ rotation(2, angle)
    a, alpha, beta = values[27:30]
    rest = translation(np.array([a, 0, 0])) @ rotation(0, alpha) @ rotation(1, beta)
    poses = poses @ rest @ translation(values[arm.layout.tip])
    assert_same(poses, tip_pose(q, np.tile(values, (len(q), 1))))


def of_rows(rows: list[dict[str, Any]], order: str, q: np.ndarray) -> np.ndarray:
    """Poses (n, 4, 4) of the last frame; *order* has a letter for each factor of a row."""
    poses = np.tile(np.eye(4), (len(q), 1, 1))
    for joint in dict.fromkeys(row["joint"] for row in rows):
        v = {r["parameter"]: float(r["value"]) for r in rows if r["joint"] == joint}
        k = int(joint) - 1
        angle = q[:, k] if k < q.shape[1] else np.zeros(len(q))
        factor = {
            "t": rotation(2, angle + math.radians(v["theta_deg"])),
            "d": translation(np.array([0, 0, v["d_mm"]])),
            "a": translation(np.array([v["a_mm"], 0, 0])),
            "x": rotation(0, math.radians(v["alpha_deg"])),
            "y": rotation(1, math.radians(v["beta_deg"])),
        }
        for letter in order:
            poses = poses @ factor[letter]
    return poses


def test_corrections_in_both_conventions(tmp_path: Path) -> None:
    arm = ur(tmp_path)
    values = calibrate(tmp_path, arm)
    values[arm.layout.base] = 0.0
    assert model(tmp_path, "c.json") == 0 and model(tmp_path, "c.csv") == 0
    told = json.loads((tmp_path / "c.json").read_text())
    with (tmp_path / "c.csv").open() as file:
        table = list(csv.DictReader(file))
    assert list(table[0]) == [
        "convention", "joint", "parameter", "nominal", "value", "difference",
        "standard_uncertainty",
    ]  # fmt: skip
    q = postures(arm, 50)
    wanted = tip_pose(q, np.tile(np.where(np.arange(39) < 30, values, 0.0), (len(q), 1)))
    for name, order, joints in (("standard", "tdaxy", 6), ("modified", "xaytd", 7)):
        rows = told[name]
        assert len(rows) == 5 * joints
        assert_same(of_rows(rows, order, q), wanted)
        for row, text in zip(rows, [r for r in table if r["convention"] == name], strict=True):
            assert row["value"] == float(text["value"]) and row["parameter"] == text["parameter"]
            assert row["value"] - row["nominal"] == pytest.approx(row["difference"], abs=1e-12)
    known = {
        (row["joint"], row["parameter"]): row["standard_uncertainty"]
        for row in told["standard"]
        if row["standard_uncertainty"] is not None
    }
    assert known == {
        (2, "theta_deg"): pytest.approx(math.degrees(1e-5)), (2, "a_mm"): pytest.approx(1e-2),
    }  # fmt: skip
    assert told["left_out"]["rms_mm"] == told["left_out"]["max_mm"] == 0.0


TERMS: list[dict[str, Any]] = [
    {"parameter": "a_2", "basis": [{"kind": "temperature", "weights": {"t1": 1.0}}],
     "coefficient": 0.02},
    {"parameter": "theta_3", "basis": [{"kind": "sin", "joint": 3}], "coefficient": 4e-4,
     "effect": "encoder_eccentricity joint 3"},
    {"parameter": "theta_2", "basis": [{"kind": "cos", "joint": 2}], "coefficient": -6e-4,
     "effect": "joint_compliance joint 2"},
]  # fmt: skip


def test_temperature_is_folded(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm = ur(tmp_path)
    values = calibrate(tmp_path, arm, TERMS[:1])
    assert model(tmp_path, "warm.json", "--at-c", 24.5) == 0
    told = json.loads((tmp_path / "warm.json").read_text())
    (a_2,) = (r for r in told["standard"] if (r["joint"], r["parameter"]) == (2, "a_mm"))
    at_20 = float(values[arm.layout.index("a_2")])
    assert a_2["value"] == pytest.approx(at_20 + 4.5 * 0.02, abs=1e-9)
    assert a_2["standard_uncertainty"] == pytest.approx(math.hypot(1e-2, 4.5e-3))
    assert told["left_out"]["max_mm"] == 0.0
    assert told["by_temperature"]["max_mm"] == pytest.approx(9.5 * 0.02, rel=1e-3)
    assert "at 15 and 25 °C" in capsys.readouterr().out


def truth(q: np.ndarray, values: np.ndarray, celsius: float) -> np.ndarray:
    """The tip with `TERMS`, written out."""
    p = np.tile(values, (len(q), 1))
    p[:, 7] += 0.02 * (celsius - 20.0)
    p[:, 10] += 4e-4 * np.sin(q[:, 2])
    p[:, 5] -= 6e-4 * np.cos(q[:, 1])
    return tip_pose(q, p)[:, :3, 3]


def test_what_is_left_out_is_as_small_as_it_can_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No geometry is better: the residuals of other postures have no column of the Jacobian, taken
    by differences, left in them."""
    arm = ur(tmp_path)
    values = calibrate(tmp_path, arm, TERMS)
    assert model(tmp_path, "new.json", "--at-c", 23) == 0
    told = json.loads((tmp_path / "new.json").read_text())
    assert told["left_out"]["terms"] == 2
    said = capsys.readouterr().out
    assert f"{told['left_out']['rms_mm']:.6f} mm RMS" in said and "joint_compliance" in said
    found = values.copy()
    for row in [*told["standard"], *told["tip"]]:
        name = row["parameter"].rpartition("_")[0]
        name = f"tip_{name}" if row["joint"] == "tip" else f"{name}_{row['joint']}"
        scale = math.radians(1.0) if row["parameter"].endswith("deg") else 1.0
        found[arm.layout.index(name)] = scale * row["value"]
    q = postures(arm, 3000)
    left = truth(q, values, 23.0) - tip_pose(q, np.tile(found, (len(q), 1)))[:, :3, 3]
    rms = math.sqrt((left**2).sum(axis=1).mean())
    assert rms == pytest.approx(told["left_out"]["rms_mm"], rel=0.03)
    assert told["left_out"]["max_mm"] > 1.2 * rms
    columns = []
    for k in range(arm.layout.base.start):
        step = np.zeros(arm.layout.count)
        step[k] = 1e-5
        ends = [tip_pose(q, np.tile(found + s, (len(q), 1)))[:, :3, 3] for s in (step, -step)]
        columns.append(((ends[0] - ends[1]) / 2e-5).ravel())
    a = np.column_stack(columns)
    better = left.ravel() - a @ np.linalg.lstsq(a, left.ravel(), rcond=1e-9)[0]
    assert math.sqrt((better**2).sum() / len(q)) > 0.985 * rms
    cut = truth(q, values, 23.0) - tip_pose(q, np.tile(values, (len(q), 1)))[:, :3, 3]
    assert math.sqrt((cut**2).sum(axis=1).mean()) > 1.2 * rms


@pytest.mark.parametrize(
    ("output", "options", "said"),
    [
        ("x.txt", (), "found the suffix '.txt', expected one of .urdf, .yaml, .json, .csv"),
        ("x.json", ("--like", "own.urdf"), "--like: found"),
        ("x.urdf", ("--tip-link", "tool0"), "--tip-link: found"),
        ("x.urdf", ("--like", "own.urdf"), "--tip-link to say which link touches"),
        ("x.urdf", ("--like", "own.urdf", "--tip-link", "link_4"), "found 4 turning joints"),
        ("x.urdf", ("--like", "own.urdf", "--tip-link", "tool"), "the tip's link: found 'tool'"),
        (
            "x.urdf", ("--like", "own.urdf", "--tip-link", "tool0", "--base-link", "left"),
            "the base link: found 'left'",
        ),
        ("x.urdf", ("--like", "own.urdf", "--tip-link", "link_5"), "joint wrist: found a joint"),
        ("x.urdf", ("--like", "turned.urdf", "--tip-link", "tool0"), "joint lift: found an axis"),
        ("x.urdf", ("--like", "wide.urdf", "--tip-link", "tool0"), "the file: found UTF-16"),
        ("x.yaml", (), "joint: found 5 joints, expected six"),
        ("x.json", ("--at-c", "5000"), "--at-c: found 5000"),
        ("cal.json", ("--force",), "an input of this run"),
        ("there.csv", (), "there.csv: -o: found a file of another kind"),
        ("there.urdf", (), "there.urdf: -o: found a file of another kind"),
        ("x.json", ("--calibration", "other.json"), "other.json: arm: found 'OTHER'"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
    output: str, options: tuple[str, ...], said: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    _, arm = own(tmp_path)
    calibrate(tmp_path, arm)
    text = json.loads((tmp_path / "cal.json").read_text()) | {"arm": "OTHER"}
    del text["content_sha256"]
    save_calibration(tmp_path / "other.json", Calibration.model_validate(text))
    Path("turned.urdf").write_text(OWN.replace("1.570796326794896619 0", "0 0.5"))
    Path("wide.urdf").write_bytes(OWN.replace('"UTF-8"', '"UTF-16"').encode("utf-16"))
    Path("there.csv").write_text("a,b\n1,2\n")
    Path("there.urdf").write_text(OWN)
    capsys.readouterr()
    before = {path.name for path in tmp_path.iterdir()}
    assert model(Path(), output, *options) == 2
    told = capsys.readouterr().err.strip()
    assert "\n" not in told and said in told
    assert {path.name for path in tmp_path.iterdir()} == before


def test_another_drawing_is_remarked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, _ = own(tmp_path)
    path.write_text(OWN.replace("0.42", "0.425"))
    options = ("--like", path, "--tip-link", "tool0")
    assert model(tmp_path, "new.urdf", *options, calibrated=False) == 0
    assert "is it the URDF that was imported?" in capsys.readouterr().err


@parametrize_default(
    ("encode", "decode"),
    [
        (lambda text: b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode(), "utf-8-sig"),
        (lambda text: text.replace("UTF-8", "ISO-8859-1").encode("latin-1"), "latin-1"),
        (lambda text: text.encode(), "utf-8"),
    ],
)
def test_any_letters_and_line_ends_stay(tmp_path: Path, encode: Any, decode: str) -> None:
    """A byte order mark, Windows' line ends, names in Latin-1, values over several lines."""
    path, arm = own(tmp_path)
    calibrate(tmp_path, arm)
    text = OWN.replace("the drawing", "die Maße, 0,5 µm").replace("own arm", "Prüfarm")
    text = text.replace('xyz="0.02 -0.1 0.42"', 'xyz="0.02\n   -0.1\n   0.42"')
    content = encode(text)
    path.write_bytes(content)
    assert model(tmp_path, "new.urdf", "--like", path, "--tip-link", "tool0") == 0
    new = (tmp_path / "new.urdf").read_bytes()
    assert without_numbers(new.decode(decode)) == without_numbers(content.decode(decode))
    assert new[:3] == content[:3] and new.count(b"\r\n") >= content.count(b"\r\n")
    q = postures(arm, 50)
    found = tip_poses(Xml.fromstring(new), q, "tool0")
    assert model(tmp_path, "plain.urdf", "--like", plain(tmp_path), "--tip-link", "tool0") == 0
    assert_same(found, tip_poses(Xml.parse(tmp_path / "plain.urdf").getroot(), q, "tool0"))


def plain(folder: Path) -> Path:
    (folder / "original.urdf").write_text(OWN)
    return folder / "original.urdf"
