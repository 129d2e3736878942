"""Before `armd: ready` everything is compiled: the stream never waits for the compiler."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import save_calibration
from armd.compiled.rehearsal import run_rehearsal
from armd.daemon.config import load_config
from armd.daemon.health import Tally
from armd.daemon.live.arm_in_use import ArmInUse
from armd.daemon.live.measurement import Averager
from armd.drivers.sample import RawFrame, Temperatures
from armd.drivers.serial import wire
from armd.drivers.serial.decoder import SerialDecoder
from armd.drivers.serial.port import SerialDriver
from armd.simulator.live.electronics import ArmParts
from armd.simulator.truth.nominal import make_arm_toml
from support.known_expansion import known_expansion
from support.running_daemon import write_config

MS = 1_000_000


def compiled() -> dict[str, int]:
    """How many signatures each compiled function of armd has been called with."""
    return {
        f"{name}.{function}": len(value.overloads)
        for name, module in list(sys.modules.items())
        if name.startswith("armd.")
        for function, value in vars(module).items()
        if hasattr(value, "overloads")
    }


def stream(decoder: SerialDecoder, arm: ArmInUse) -> set[str]:
    """A bit of everything that may come over the wire; the flags and events it gave."""
    seen: set[str] = set()
    tally, averager = Tally(0), Averager(0.5, 6)

    def feed(k: int, direction: str, data: bytes) -> None:
        for item in decoder.feed(RawFrame(k * MS, k * MS, direction, data)):
            if isinstance(item, Temperatures):
                arm.pipeline.take_temperatures(item)
                seen.add("temperatures")
            elif isinstance(item, np.ndarray):
                points, joints = arm.pipeline.correct(item)
                averager.remember(points, joints.q)
                tally.add(points, item, k * MS)
                seen.update(tally.close_second(k * MS).flagged)
                seen.add("mapped" if item["clock_mapped"].all() else "unmapped")
            else:
                seen.add(item.kind)

    def sample(seq: int, status: int = 0, count: int = 0) -> bytes:
        return wire.encode_sample(seq, 1000 * (seq + 1), [count] * 6, status)

    hello = wire.Hello(1, 6, 6, 1000, 1, "SIM-0001", ArmParts.for_demo_arm(6).bits)
    feed(0, "link", b"up")
    feed(1, "rx", b"\0" + sample(0) + wire.encode_hello(hello) + sample(1))
    for k in range(2, 40):
        feed(k, "tx", wire.encode_ping(k))
        feed(k, "rx", wire.encode_pong(k, 1000 * k) + sample(k))
        feed(k, "rx", wire.encode_temperature(1000 * k, [20.0, np.nan, 21.0, 20.0, 20.0, 20.0]))
    feed(40, "rx", sample(42) + sample(43, status=1) + sample(44))
    feed(41, "rx", sample(45, count=2_000_000) + sample(45) + sample(3))
    return seen


def main(config: Path) -> None:
    loaded = load_config(config)
    arm = ArmInUse(loaded)
    run_rehearsal(loaded, arm)
    driver = SerialDriver(loaded.file.driver, loaded.expectation)
    driver.open()
    before = compiled()
    seen = stream(SerialDecoder(loaded.expectation), arm)
    print(sorted(seen))
    late = {name for name, count in compiled().items() if count != before.get(name, 0)}
    assert before and not late, f"compiled while samples came: {sorted(late)}"


def test_nothing_is_compiled_while_samples_come(tmp_path):
    (tmp_path / "arm.toml").write_text(make_arm_toml("SIM-0001"))
    arm = load_arm(tmp_path / "arm.toml")
    save_calibration(tmp_path / "calibration.json", known_expansion(arm, 2e-6))
    config = write_config(
        tmp_path, "none", "tcp/127.0.0.1:0", top='calibration = "calibration.json"'
    )
    run = subprocess.run(  # a process of its own: here other tests have compiled much already
        [sys.executable, __file__, str(config)],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])},
    )
    assert run.returncode == 0, run.stderr
    for expected in ("identified", "mapped", "unmapped", "temperatures", "joint_invalid"):
        assert expected in run.stdout
    for expected in ("SAMPLES_LOST", "INVALID", "TEMPERATURE_STALE", "count_jump"):
        assert expected in run.stdout


if __name__ == "__main__":
    main(Path(sys.argv[1]))
