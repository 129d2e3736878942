"""`armd record` and `armd replay`: what was published comes back, bit by bit."""

import argparse
import io
import json
import os
import re
import signal
import subprocess
from types import SimpleNamespace

import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType, Writer

from armd.daemon.cli import main
from armd.daemon.commands.service import replay
from armd.daemon.files.recorder import Recorder
from armd.drivers.config import ReplayConfig
from armd.drivers.identity import Expectation
from armd.drivers.replay import raw
from armd.drivers.replay.driver import ReplayDriver
from armd.drivers.replay.mcap_file import MOST_BYTES
from armd.drivers.replay.recording import INFO_ATTACHMENT, RAW_TOPIC, Recording
from armd.drivers.sample import RawFrame
from armd.errors import BadInput
from armd.simulator.truth.nominal import make_arm_toml
from support.program import ARMD, run_armd, start_recording
from support.running_daemon import free_endpoint, running_daemon
from support.simulated_arm import simulated_arm
from support.waiting import PATIENCE_S, wait_until


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A recording that ended well, one that was killed, and the points of the daemon's life."""
    folder = tmp_path_factory.mktemp("recording")
    whole, cut = folder / "whole.mcap", folder / "cut.mcap"
    with (
        simulated_arm(folder, rate_hz=500, link=True) as arm,
        running_daemon(folder, arm.port) as daemon,
    ):
        first, second = (start_recording(daemon.endpoint, "-o", path) for path in (whole, cut))
        wait_until(lambda: whole.stat().st_size >= 220_000)
        first.send_signal(signal.SIGINT)
        wait_until(lambda: cut.stat().st_size >= 220_000)
        second.kill()
        out, _ = first.communicate(timeout=PATIENCE_S)
        second.communicate()
        assert first.returncode == 0, out
        assert "0 raw frames lost" in out
    return whole, cut


def topics(path):
    counted = {}
    for message in Recording(path).messages():
        counted[message.topic] = counted.get(message.topic, 0) + 1
    return counted


def test_everything_is_in_it_and_points_in_that_of_a_killed_recorder(recorded):
    whole, cut = recorded
    assert topics(cut)["/point"] > 100
    counted = topics(whole)
    assert counted["/raw"] > 100 and counted["/point"] > 100 and counted["/health"] >= 1
    recording = Recording(whole)
    assert recording.info["arm"]["serial_number"] == "SIM-0001"
    assert recording.info["configuration"]["driver"]["kind"] == "serial"


@pytest.mark.parametrize("which", [0, 1])
def test_a_replay_gives_the_recorded_points_again(recorded, which, capsys):
    assert main(["replay", str(recorded[which]), "--check"]) == 0
    said = capsys.readouterr().out
    identical = int(said.split()[1])
    assert identical > 100
    # Every recorded point is compared, or it is said why not.
    skipped = [int(n) for n in re.findall(r"(\d+) recorded points? not compared: ", said)]
    assert identical + sum(skipped) == topics(recorded[which])["/point"]


def test_a_replay_as_a_table(recorded, tmp_path):
    table = tmp_path / "points.csv"
    assert main(["replay", str(recorded[0]), "-o", str(table)]) == 0
    lines = table.read_text().splitlines()
    assert lines[0].startswith("seq,stamp_ns,x_mm") and len(lines) > 100


def test_another_file_is_refused(tmp_path):
    path = tmp_path / "no.mcap"
    path.write_bytes(b"this is not a recording")
    with pytest.raises(BadInput, match=r"expected a recording"):
        Recording(path)
    assert main(["replay", str(path), "--check"]) == 2
    with pytest.raises(BadInput, match="found nothing"):
        Recording(tmp_path / "nothing.mcap")


@pytest.mark.slow
def test_it_is_published_like_a_live_arm(recorded, tmp_path):
    endpoint = free_endpoint()
    with subprocess.Popen(
        [*ARMD, "replay", str(recorded[0]), "--listen", endpoint, "--speed", "0.1"],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ,
    ) as replay:
        assert replay.stdout is not None and "ready" in replay.stdout.readline()
        watched = run_armd("watch", "--json", "--seconds", "3", "--endpoint", endpoint)
        replay.terminate()
        assert replay.wait(PATIENCE_S) == 0
    points = [json.loads(line) for line in watched.stdout.splitlines()]
    assert len(points) > 10


# --- damaged and forged files --------------------------------------------------------------------

INFO = {"arm": {}, "configuration": {"driver": {"kind": "serial", "port": "x"}}}


def frame(n):
    return raw.pack(n, RawFrame(10**12 + n, 10**18 + n, "rx", bytes([n % 251]) * 200))


def small_recording(info=None, n=1200):
    """A recording of a few chunks, as bytes."""
    file = io.BytesIO()
    recorder = Recorder(file, info or INFO, None)
    recorder.begin(0, [])
    recorder.take_frames([frame(k) for k in range(n)])
    recorder.close()
    return file.getvalue()


def read_all(path):
    recording = Recording(path)
    return recording, sum(1 for _ in recording.frames())


def test_every_flipped_bit_is_noticed(tmp_path):
    data, path = small_recording(), tmp_path / "flipped.mcap"
    rng = np.random.default_rng(1)
    path.write_bytes(data)
    assert read_all(path)[1] == 1200
    # All over the file, and densely where checksums are hard to come by: both ends.
    at = [*rng.integers(0, len(data), 400), *range(60), *range(len(data) - 60, len(data))]
    for byte in at:
        flipped = bytearray(data)
        flipped[byte] ^= 1 << rng.integers(8)
        path.write_bytes(flipped)
        with pytest.raises(BadInput, match=r"flipped\.mcap"):
            read_all(path)
            pytest.fail(f"byte {byte} of {len(data)}")


def test_a_cut_recording_says_what_is_missing(tmp_path):

    data, path = small_recording(), tmp_path / "cut.mcap"
    seen = set()
    for part in (0.99, 0.9, 0.7, 0.5):
        path.write_bytes(data[: int(part * len(data))])
        recording, n = read_all(path)
        assert (
            "found no end" in recording.missing
            and f"{n} raw frames, until 2001-" in recording.missing
        )
        seen.add(n)
    assert max(seen) <= 1200 and len(seen) >= 2
    path.write_bytes(data[:-20])
    recording, n = read_all(path)
    assert n == 1200 and "the index is missing" in recording.missing


def write_file(path, info, message=None):
    """With *info* and one raw frame at most, by the library alone."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1, compression=CompressionType.ZSTD)
        writer.start()
        writer.add_attachment(0, 0, INFO_ATTACHMENT, "application/json", json.dumps(info).encode())
        if message is not None:
            channel = writer.register_channel(RAW_TOPIC, "x", schema_id=0)
            writer.add_message(channel, 0, message, 0)
        writer.finish()


def test_a_chunk_that_would_fill_the_memory_is_not_unpacked(tmp_path):
    path = tmp_path / "bomb.mcap"
    write_file(path, INFO, bytes(MOST_BYTES + 1))
    assert path.stat().st_size < 10_000
    with pytest.raises(BadInput, match="would fill the memory"):
        Recording(path)


def test_a_chunk_that_lies_about_its_size_is_not_unpacked_either(tmp_path):
    bomb = zstandard.ZstdCompressor(write_content_size=False).compress(bytes(1 << 26))
    data = small_recording()
    at = data.index(zstandard.FRAME_HEADER)
    length = int.from_bytes(data[at - 8 : at], "little")
    path = tmp_path / "lies.mcap"
    forged = data[: at - 8] + len(bomb).to_bytes(8, "little") + bomb
    forged += bytes(max(0, length - len(bomb))) + data[at + length :]
    path.write_bytes(forged)
    with pytest.raises(BadInput, match="byte"):
        Recording(path)


@pytest.mark.parametrize(
    ("driver", "message"),
    [
        ({"kind": "abacus"}, "driver.kind: found 'abacus', expected a kind"),
        ({"kind": "replay", "file": "x"}, "driver.kind: found 'replay'"),
        ({"kind": "serial", "port": "x", "baud": "fast"}, "baud"),
    ],
)
def test_a_driver_that_has_no_decoder_here_is_not_decoded_by_another(tmp_path, driver, message):

    path = tmp_path / "other.mcap"
    path.write_bytes(small_recording({"arm": {}, "configuration": {"driver": driver}}))
    with pytest.raises(BadInput, match=message):
        ReplayDriver(ReplayConfig(kind="replay", file=str(path)), Expectation("A", 6, 6, (1,) * 6))


def test_a_recording_on_can_replays_whatever_its_bus_was(tmp_path):

    driver = {"kind": "can", "interface": "gone", "speciality": 1, "rate_hz": 250.0}
    path = tmp_path / "can.mcap"
    path.write_bytes(small_recording({"arm": {}, "configuration": {"driver": driver}}))
    expected = Expectation("A", 6, 6, (1 << 20,) * 6)
    replay = ReplayDriver(ReplayConfig(kind="replay", file=str(path), speed=0), expected)
    with pytest.raises(BadInput, match="raw frame of"):  # its frames are no link notes
        replay._decode(RawFrame(0, 0, "link", b"nonsense", "can"))


@pytest.mark.parametrize("info", [[], {}, {"arm": {}}, {"arm": {}, "configuration": 3}])
def test_info_that_is_none(tmp_path, info):
    path = tmp_path / "info.mcap"
    write_file(path, info)
    with pytest.raises(BadInput, match="info"):
        Recording(path)


@pytest.mark.slow
def test_an_arm_that_says_nothing_is_told_at_once_and_at_the_end(tmp_path):
    (tmp_path / "arm.toml").write_text(make_arm_toml())
    silent, out = tmp_path / "unplugged", tmp_path / "silent.mcap"
    with running_daemon(tmp_path, str(silent)) as daemon:
        told = run_armd("record", "--endpoint", daemon.endpoint, "--seconds", "2", "-o", out)
    assert told.returncode == 1
    assert "warning: SIM-0001 is NOT_READY: " in told.stderr and str(silent) in told.stderr
    assert f"armd: {out}: raw frames: found none, expected some" in told.stderr
    assert "/health" in topics(out)


def test_a_replay_obeys_no_command_that_the_recorded_daemon_would(tmp_path):
    arm = {"schema": "armd.arm/1", "serial_number": "A", "joint": [{"a_mm": 100.0}] * 3}
    arm |= {"tip": {"offset_mm": [0.0, 0.0, 100.0]}}
    configuration = {"schema": "armd.daemon/1", "arm": "arm.toml", "commands": {"enabled": True}}
    info = {"configuration": configuration, "arm": arm}
    recording = SimpleNamespace(path=tmp_path / "r.mcap", attachments={}, info=info)
    asked = ["--speed", "1", "--listen", "tcp/127.0.0.1:0"]
    parser = argparse.ArgumentParser()
    replay.add_arguments(parser)
    config = replay._make_config(recording, parser.parse_args(["r.mcap", *asked]), tmp_path)
    assert config.file.driver.kind == "replay" and not config.file.commands.enabled


def test_a_recorder_is_never_kept_by_a_pipe(tmp_path):
    """It would wait for somebody to read it, deaf to every signal."""
    os.mkfifo(tmp_path / "pipe.mcap")
    words = ["record", "-o", "pipe.mcap", "--endpoint", "tcp/127.0.0.1:9"]
    done = run_armd(*words, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("armd: pipe.mcap: -o: found a pipe")
