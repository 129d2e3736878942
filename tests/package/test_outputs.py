"""What a command may write over: its own kind; with --force anything but an input of the run."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from armd import BadInput, NoAnswer
from armd.files.outputs import (
    ARM,
    CALIBRATION,
    FAULT_LOG,
    PAGE,
    PDF,
    PDF_MARK,
    POINTS,
    POSES,
    RECORDING,
    RESULT,
    SETTINGS,
    TRUTH,
    OutputKind,
    check_output_folder,
    check_outputs,
    check_same,
)
from armd.files.writing import explain_os_errors

#: what commands write, by kind
WRITTEN: dict[str, tuple[OutputKind, bytes]] = {
    "calibration": (CALIBRATION, b'{\n "schema": "armd.calibration/1",\n "arm": "A"\n}\n'),
    "small calibration": (CALIBRATION, b'{"schema":"armd.calibration/1","arm":"A"}'),
    "result": (RESULT, json.dumps({"rms_um": 1.0, "n": 3}, indent=1).encode()),
    "diagnosis": (RESULT, b'{\n "schema": "armd.diagnosis/1"\n}'),
    "report": (PAGE, b'<!doctype html><meta name="generator" content="armd"><p>'),
    "printed": (PDF, b"%PDF-1.4\n" + bytes(1 << 17) + b"%%EOF\n" + PDF_MARK),
    "points": (POINTS, b"time_s,q1,x_mm,y_mm,z_mm,u_x_mm,u_y_mm,u_z_mm,flags\n1,2\n"),
    "replayed": (POINTS, b"seq,stamp_ns,x_mm,y_mm,z_mm,qx,qy,qz,qw,flags\r\n1,2\r\n"),
    "poses": (POSES, b"pose,x_mm,y_mm\r\n1,2,3\r\n"),
    "truth": (TRUTH, bytes(64)),
    "settings": (SETTINGS, b'{\n "plants": [],\n "constants": {}}'),
    "faults": (FAULT_LOG, b'{"event": "boot"}\n'),
}
#: what no command writes over unasked
OTHERS: dict[str, bytes] = {
    "arm.toml": b'schema = "armd.arm/1"\nserial_number = "A"\n',
    "session.toml": b'schema = "armd.session/1"\n',
    "readings.csv": b"time_s,placement,target,q1,x_mm,y_mm,z_mm\n1,2,3,4,5,6,7\n",
    "recording": b"\x89MCAP0\r\n" + bytes(64),
    "page": b"<!doctype html><title>armd and I</title>",
    "foreign": b'{"name": "armd.calibration/1"}',
    "text": b"Dear Ann,\n",
}


@pytest.mark.parametrize("name", WRITTEN)
@pytest.mark.parametrize("standing", [*WRITTEN, *OTHERS])
def test_only_its_own_kind_is_written_over(tmp_path: Path, name: str, standing: str) -> None:
    kind = WRITTEN[name][0]
    path = tmp_path / standing
    path.write_bytes(WRITTEN[standing][1] if standing in WRITTEN else OTHERS[standing])
    outputs: dict[str, tuple[str | Path | None, OutputKind]] = {"-o": (path, kind)}
    if standing in WRITTEN and WRITTEN[standing][0] is kind:
        check_outputs(outputs, [], force=False)
    else:
        with pytest.raises(BadInput, match=f"-o: found .*, or {kind.name} of before"):
            check_outputs(outputs, [], force=False)
        check_outputs(outputs, [], force=True)


@pytest.mark.parametrize("kind", [RECORDING, ARM])
def test_what_cannot_be_had_again_is_kept(tmp_path: Path, kind: OutputKind) -> None:
    path = tmp_path / "file"
    path.touch()  # nothing is lost
    check_outputs({"-o": (path, kind)}, [], force=False)
    path.write_bytes(OTHERS["recording"])
    with pytest.raises(BadInput, match=r"a recording, which cannot be had again, .*--force"):
        check_outputs({"-o": (path, kind)}, [], force=False)
    check_outputs({"-o": (path, kind)}, [], force=True)


def test_an_input_is_never_written_over(tmp_path: Path) -> None:
    session = tmp_path / "session"
    session.mkdir()
    for path in (tmp_path / "arm.toml", session / "readings.csv"):
        path.write_text("x")
    (tmp_path / "same").mkdir()
    (tmp_path / "same" / "by-link").hardlink_to(tmp_path / "arm.toml")
    os.chdir(tmp_path)
    for name in ("arm.toml", "same/../arm.toml", "session/readings.csv", "same/by-link"):
        for force in (False, True):
            with pytest.raises(BadInput, match="an input of this run"):
                check_outputs(
                    {"-o": (tmp_path / name, ARM)}, [tmp_path / "arm.toml", session], force
                )
    with pytest.raises(BadInput, match="an input of this run"):
        check_same(tmp_path / "arm.toml", "x", ARM, True, [tmp_path / "arm.toml"])


def test_two_outputs_are_two_files(tmp_path: Path) -> None:
    twice = {"-o": (tmp_path / "x", CALIBRATION), "--json": (f"{tmp_path}/./x", RESULT)}
    with pytest.raises(BadInput, match="--json: found the file of -o"):
        check_outputs(twice, [], force=True)
    check_outputs({"-o": ("/dev/null", ARM), "--json": ("/dev/null", ARM)}, [], force=False)


def test_the_same_may_be_written_again(tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    check_same(path, "a = 1", ARM, force=False)
    path.write_text("a = 1")
    check_same(path, "a = 1", ARM, force=False)
    with pytest.raises(BadInput, match=r"an arm.toml with another content, .*--force"):
        check_same(path, "a = 2", ARM, force=False)
    check_same(path, "a = 2", ARM, force=True)


def test_a_folder_can_be_made_or_written_in(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    check_output_folder(tmp_path)
    check_output_folder(tmp_path / "new" / "newer")
    for name in ("file", "file/new"):
        with pytest.raises(BadInput, match="found a file"):
            check_output_folder(tmp_path / name)


def test_an_arm_that_does_not_answer_is_no_fault_of_the_file(tmp_path: Path) -> None:
    """It is a time-out, which Python counts among the system's refusals."""
    with pytest.raises(NoAnswer, match="no answer"), explain_os_errors(tmp_path / "points.csv"):
        raise NoAnswer("armd/T/info: no answer")
    with (
        pytest.raises(BadInput, match=r"points\.csv: the file: found"),
        explain_os_errors(tmp_path / "points.csv"),
    ):
        raise TimeoutError("the disk is slow")
