"""`armd record --lake`: every point with its joints and temperatures, in files that are whole."""

import signal
import time
from pathlib import Path

import numpy as np
import pyarrow.dataset
import pyarrow.parquet as pq
import pytest

from armd.daemon.files.lake import Lake
from armd.errors import BadInput
from support.program import start_recording
from support.published import SECOND_NS, day_ns, payloads, published
from support.running_daemon import running_daemon
from support.simulated_arm import simulated_arm
from support.waiting import PATIENCE_S

COVARIANCE = ["xx_mm2", "xy_mm2", "xz_mm2", "yy_mm2", "yz_mm2", "zz_mm2"]


def a_lake(folder: Path, sensors: tuple[str, ...] = ("t1",)) -> Lake:
    return Lake(folder, "A-1", 6, list(sensors))


def rows_of(folder: Path):
    files = sorted(folder.rglob("*.parquet"))
    return pyarrow.dataset.dataset(files).to_table()


def test_what_was_published_comes_back_by_arm_and_day(tmp_path):
    points, joints = published(2000, day_ns("2026-03-02") - SECOND_NS)
    lake = a_lake(tmp_path)
    lake.take(payloads(points[:700]), payloads(joints[:700]))
    lake.take(payloads(points[700:]), payloads(joints[700:]))
    lake.write()
    lake.close()
    days = {path.parent.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.parquet")}
    assert days == {"serial=A-1/day=2026-03-01", "serial=A-1/day=2026-03-02"}
    rows = rows_of(tmp_path)
    assert (lake.rows, lake.files, lake.without_joints) == (2000, 2, 0)
    for name in ("seq", "stamp_ns", "flags", "calibration"):
        assert np.array_equal(rows[name], points[name])
    for k in range(6):
        assert np.array_equal(rows[f"q{k + 1}"], joints["angle_rad"][:, k])
        assert np.array_equal(rows[f"w{k + 1}"], joints["rate_rad_s"][:, k])
        assert np.array_equal(rows[COVARIANCE[k]], points["covariance_mm2"][:, k])
    for axis, name in enumerate(("x_mm", "y_mm", "z_mm")):
        assert np.array_equal(rows[name], points["position_mm"][:, axis])
    assert pq.read_table(tmp_path, filters=[("day", "=", "2026-03-02")]).num_rows == 1000


def test_a_point_has_the_temperatures_heard_last(tmp_path):
    start_ns = day_ns("2026-03-01")
    points, joints = published(4000, start_ns)
    lake = a_lake(tmp_path, ("t1", "t2"))
    for second, warm in ((0, 20.0), (1, None), (3, 22.0)):
        lake.take_temperatures(start_ns + second * SECOND_NS, {"t1": warm, "t2": 20.5})
    lake.take(payloads(points[:1500]), payloads(joints[:1500]))
    lake.write()
    lake.take(payloads(points[1500:]), payloads(joints[1500:]))
    lake.close()
    rows = rows_of(tmp_path)
    expected = [20.0] * 1000 + [None] * 2000 + [22.0] * 1000
    assert rows["t1"].to_pylist() == expected
    assert rows["t2"].to_pylist() == [20.5] * 4000


def test_a_point_waits_for_its_joints_a_second_at_most(tmp_path):
    points, joints = published(3000, day_ns("2026-03-01"))
    lake = a_lake(tmp_path)
    lake.take(payloads(points[:2000]), payloads(np.delete(joints[:1800], [300, 1700])))
    lake.write()  # 300 and 1700 were lost on the way: later ones came; those from 1800 on may come
    assert (lake.rows, lake.without_joints) == (1800, 2)
    lake.take(payloads(points[2000:]), payloads(joints[1800:1900]))
    lake.write()  # a second after them, 1900 … 1998 are given up
    assert lake.rows == 1999
    lake.close()
    rows = rows_of(tmp_path)
    assert np.array_equal(rows["seq"], points["seq"])
    missing = np.flatnonzero(rows["q3"].is_null().to_numpy())
    assert missing.tolist() == [300, 1700, *range(1900, 3000)]
    assert np.array_equal(rows["x_mm"], points["position_mm"][:, 0])


def test_the_same_number_of_another_stream_is_another_point(tmp_path):
    before, joints_before = published(10, day_ns("2026-03-01"))
    after, joints_after = published(10, day_ns("2026-03-01") + SECOND_NS, n_joints=6)
    joints_after["angle_rad"] += 1
    lake = a_lake(tmp_path)
    lake.take(payloads(before) + payloads(after), payloads(joints_before) + payloads(joints_after))
    lake.close()
    expected = np.concatenate([joints_before, joints_after])["angle_rad"][:, 0]
    assert np.array_equal(rows_of(tmp_path)["q1"], expected)


def test_one_recorder_an_arm(tmp_path):
    lake = a_lake(tmp_path)
    with pytest.raises(BadInput, match="another recorder that writes this arm"):
        a_lake(tmp_path)
    lake.close()
    a_lake(tmp_path).close()
    assert not list(tmp_path.rglob("*.parquet"))


def test_what_cannot_be_written_is_refused(tmp_path):
    with pytest.raises(
        BadInput, match=r"temperature_sensor\.name: found 'flags', expected another"
    ):
        a_lake(tmp_path, ("flags",))
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="the folder: found a file"):
        a_lake(tmp_path / "file")


def test_a_file_appears_whole_or_not_at_all(tmp_path, monkeypatch):
    points, joints = published(100, day_ns("2026-03-01"))
    lake = a_lake(tmp_path)
    lake.take(payloads(points), payloads(joints))

    def fail(*_: object) -> None:
        assert list(tmp_path.rglob("*.part"))
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr("armd.daemon.files.lake.write_group", fail)
        with pytest.raises(BadInput, match="no space left"):
            lake.write()
    assert [path.name for path in lake.folder.rglob("*") if path.is_file()] == [".armd-lake.lock"]
    lake.close()  # there is room again: nothing is lost
    assert rows_of(tmp_path).num_rows == 100 and lake.without_joints == 0


# --- a daemon's points ---------------------------------------------------------------------------


@pytest.mark.slow
def test_every_point_of_a_daemon_is_there(tmp_path):
    lake = tmp_path / "lake"
    with (
        simulated_arm(tmp_path, rate_hz=1000) as arm,
        running_daemon(tmp_path, arm.port) as daemon,
        daemon.listen() as heard,
    ):
        recorder = start_recording(daemon.endpoint, "--lake", lake)
        begun = len(heard.points())
        heard.wait_for(lambda: len(heard.points()) > begun + 2000)
        recorder.send_signal(signal.SIGINT)
        said, _ = recorder.communicate(timeout=PATIENCE_S)
        published = heard.points()
    assert recorder.returncode == 0, said
    rows = rows_of(lake)
    seq = rows["seq"].to_numpy()
    within = published[(published["seq"] >= seq[0]) & (published["seq"] <= seq[-1])]
    assert len(seq) >= 1000 and f"{len(seq)} points in 1 file; 0 lost, 0 without joints" in said
    assert np.array_equal(seq, within["seq"])
    assert np.array_equal(rows["x_mm"], within["position_mm"][:, 0])
    assert rows["q1"].null_count == 0


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_killed_recorder_loses_a_minute_at_most(tmp_path):
    lake = tmp_path / "lake"
    with (
        simulated_arm(tmp_path, rate_hz=200) as arm,
        running_daemon(tmp_path, arm.port) as daemon,
    ):
        recorder = start_recording(daemon.endpoint, "--lake", lake)
        time.sleep(65)
        recorder.kill()
        recorder.communicate()
        killed_ns = time.time_ns()
        rows = rows_of(lake)
        assert killed_ns - rows["stamp_ns"].to_numpy().max() < 60 * SECOND_NS
        assert (np.diff(rows["seq"].to_numpy().astype(int)) == 1).all()
        # Nothing is to be cleaned.
        again = start_recording(daemon.endpoint, "--lake", lake, "--seconds", "2")
        again.communicate(timeout=PATIENCE_S)
        assert again.returncode == 0
    assert rows_of(lake).num_rows > len(rows)
