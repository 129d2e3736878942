"""`armd stream`: its lines by the contract, from a live arm; readers that come, stall and go."""

from __future__ import annotations

import csv
import json
import re
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from measurement import MEASUREMENT
from scipy.spatial.transform import Rotation

from armd import POINT, Flag
from armd.daemon.bridges import lines
from armd.daemon.bridges.tips import Tips, rotate
from armd.errors import BadInput
from support.pages import page_path
from support.program import ARMD, run_armd
from support.punctuality import Punctuality
from support.running_bridge import running_bridge
from support.running_daemon import Daemon, running_daemon
from support.simulated_arm import simulated_arm

INFO = {
    "arm": {"tip": {"offset_mm": [0.0, 0.0, 100.0], "radius_mm": 3.0}},
    "configuration": {"tips": {"long": {"offset_mm": [0.0, 50.0, 0.0], "radius_mm": None}}},
    "tip": None,
}
TIPS = Tips(INFO)
PAGE = page_path("record-export")


def fields(**changes: Any) -> lines.Fields:
    told = lines.convert_measurement(MEASUREMENT | changes, TIPS, "SIM-0001")
    assert told is not None
    return told


def test_presets() -> None:
    assert lines.format_xyz(fields()) == "1.500000 -2.250000 3.000000 0.000000 -0.600000 0.800000"
    assert lines.format_pcdmis(fields()) == "X1.500000,Y-2.250000,Z3.000000"
    row = dict(
        zip(
            lines.CSV_HEADER.split(","), next(csv.reader([lines.format_csv(fields())])), strict=True
        )
    )
    assert row["stamp_ns"] == "1700000000123456789"
    assert float(row["u_y_mm"]) == pytest.approx(0.02)
    assert float(row["sd_z_mm"]) == pytest.approx(0.003)
    assert (row["count"], row["flags"], row["seq"]) == ("12", "512", "7")
    assert json.loads(lines.format_jsonl(fields())) == MEASUREMENT


def test_the_page_shows_these_lines() -> None:
    shown = PAGE.read_text(encoding="utf-8").splitlines()
    for line in (lines.format_xyz, lines.format_pcdmis, lines.format_csv):
        assert line(fields()) in shown
    assert lines.CSV_HEADER in shown
    own = next(line.partition("--template ")[2] for line in shown if "--template '" in line)
    assert lines.parse_template(own.strip().strip("'"))(fields()) in shown
    words = [word for line in shown for word in re.findall(r"^\| `([a-z_0-9`, ]+)` \|", line)]
    assert {name for word in words for name in word.split("`, `")} - set(lines.PRESETS) == set(
        lines.FIELDS
    )


def test_without_travel_the_shaft_shows_the_way() -> None:
    # The last frame turned by 90° about x: its z lies along −y of the base.
    half = np.sqrt(0.5)
    told = fields(approach=None, orientation=[half, 0.0, 0.0, half])
    assert (told["i"], told["j"], told["k"]) == pytest.approx((0, 1, 0), abs=1e-12)
    told = fields(approach=None, tip="long")
    assert (told["i"], told["j"], told["k"]) == pytest.approx((0, -1, 0))
    # As the tip was known then, whatever it is called and calibrated to be now.
    told = fields(approach=None, tip="long", tip_offset_mm=[9.0, 0.0, 0.0], tip_radius_mm=1.0)
    assert (told["i"], told["j"], told["k"]) == pytest.approx((-1, 0, 0))


def test_what_is_not_known_is_empty_and_names_are_quoted() -> None:
    told = fields(standard_deviation_mm=None, covariance_mm2=None, tip='ruby, 3"')
    row = next(csv.reader([lines.format_csv(told)]))
    assert row[7:13] == [""] * 6
    assert row[17] == 'ruby, 3"'


def test_no_line_without_a_position() -> None:
    assert lines.convert_measurement(MEASUREMENT | {"position_mm": None}, TIPS, "S") is None
    point = np.zeros(1, POINT)[0]
    point["flags"] = Flag.INVALID
    assert lines.convert_point(point, TIPS, None, "S") is None


def test_templates() -> None:
    assert lines.parse_template("{x:.1f}\\t{tip}|{seq}")(fields()) == "1.5\t|7"
    for bad in ("{q}", "{x", "{}", "{x.__class__}", "{x:d}", "a\nb"):
        with pytest.raises(BadInput, match="--template"):
            lines.parse_template(bad)


@settings(deadline=None)
@given(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_turning_by_a_quaternion_is_scipys(q: tuple[float, ...]) -> None:
    unit = np.array(q) / np.linalg.norm(q)
    expected = Rotation.from_quat(unit).apply([0.3, -0.5, 0.8])
    assert rotate(unit.tolist(), (0.3, -0.5, 0.8)) == pytest.approx(expected, abs=1e-12)


# --- live ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def daemon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    folder = tmp_path_factory.mktemp("stream")
    with simulated_arm(folder) as arm, running_daemon(folder, arm.port) as daemon:
        yield daemon


def options(daemon: Daemon, *more: str) -> list[str]:
    return ["SIM-0001", "--endpoint", daemon.endpoint, "--listen", "127.0.0.1:0", *more]


def read_lines(connection: socket.socket, n: int) -> list[str]:
    with connection.makefile(encoding="utf-8") as file:
        return [file.readline().removesuffix("\n") for _ in range(n)]


def test_a_line_per_measurement_and_nothing_past(daemon: Daemon) -> None:
    with daemon.listen() as heard, running_bridge("stream", *options(daemon)) as bridge:
        heard.wait_for(lambda: heard.json("measurement"))
        with bridge.connect() as first, bridge.connect() as second:
            since_ns = time.time_ns()
            line = read_lines(first, 1)[0]
            assert read_lines(second, 1) == [line]
        values = [float(word) for word in line.split(" ")]

        def matching() -> list[dict[str, Any]]:
            return [
                m
                for m in heard.json("measurement")
                if m["position_mm"] and np.allclose(m["position_mm"], values[:3], atol=1e-6)
            ]

        heard.wait_for(matching)  # the bridge may have heard it first
        told = matching()
        assert len(told) == 1
        assert told[0]["stamp_ns"] > since_ns - 0.5e9
        if told[0]["approach"] is not None:  # which a machine that stands still leaves unknown
            assert np.allclose(values[3:], -np.array(told[0]["approach"]), atol=1e-6)
        assert bridge.stop(signal.SIGTERM) == 0


def test_points_at_a_rate_beside_a_reader_that_stands_still(
    daemon: Daemon, punctuality: Punctuality
) -> None:
    more = ("--points", "50", "--format", "jsonl")
    with (
        punctuality.watch() as machine,
        running_bridge("stream", *options(daemon, *more)) as bridge,
    ):
        with bridge.connect() as stalled, bridge.connect() as reading:
            stalled.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
            reading.sendall(b"nobody listens to this\r\n" * 100)
            reading.shutdown(socket.SHUT_WR)  # as `nc < /dev/null` does
            told = [json.loads(line) for line in read_lines(reading, 100)]
        stamps = np.array([line["stamp_ns"] for line in told])
        # Stamps may step back where a starved machine read late and its clock is mapped anew
        assert (np.diff([line["seq"] for line in told]) > 0).all()
        took_s = (stamps[-1] - stamps[0]) * 1e-9
        assert took_s > 99 / 50 - 0.05
        assert all(len(line["position_mm"]) == 3 for line in told)
        assert {type(line["seq"]) for line in told} == {int}
        assert bridge.stop(signal.SIGINT) == 0
    machine.judge(took_s, 99 / 50 + 0.05, "a hundred points at 50 Hz")


def test_csv_begins_with_its_header(daemon: Daemon) -> None:
    more = ("--points", "20", "--format", "csv")
    with running_bridge("stream", *options(daemon, *more)) as bridge, bridge.connect() as reader:
        header, line = read_lines(reader, 2)
        assert header.startswith("stamp_ns,x_mm,y_mm,z_mm,")
        assert len(line.split(",")) == len(header.split(","))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--points", "0"], "--points: found 0, expected"),
        (["--template", "{nonsense}"], "--template: found field 'nonsense', expected one of x"),
        (["--listen", "127.0.0.1"], "expected HOST:PORT"),
    ],
)
def test_bad_usage(words: list[str], said: str) -> None:
    done = run_armd("stream", *words)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def test_an_occupied_port_is_named(daemon: Daemon, tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        where = f"127.0.0.1:{taken.getsockname()[1]}"
        done = run_armd("stream", "--endpoint", daemon.endpoint, "--listen", where)
    assert done.returncode == 2
    assert done.stderr.startswith(f"armd: the command line: --listen: found {where}: ")


@pytest.mark.slow
def test_ended_while_it_waits_for_its_daemon() -> None:
    command = [*ARMD, "stream", "--verbose", "--endpoint", "tcp/127.0.0.1:9"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert "connecting to tcp/127.0.0.1:9" in process.stderr.readline()  # and nobody answers
        process.terminate()
        assert process.wait(60) == 0
