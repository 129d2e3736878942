"""`armd fleet`: arms behind one router, who may speak for whom, two daemons of one serial."""

from __future__ import annotations

import json
import subprocess
import time
import urllib.request
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trustme
import zenoh

import armd
from armd import POINT, Lost
from armd.daemon.bridges.fleet import Fleet
from support.careless_network import session
from support.certificates import write_certificate
from support.long_case import long_case
from support.program import ARMD
from support.running_bridge import running_bridge
from support.running_daemon import free_endpoint, running_daemon, session_with
from support.simulated_arm import simulated_arm
from support.waiting import PATIENCE_S, wait_until

EXAMPLES = Path(__file__).parents[2] / "deploy" / "zenoh"


def health(serial: str, **changes: Any) -> dict[str, Any]:
    return {
        "serial": serial, "state": "READY", "reason": "measuring", "stamp_ns": 1, "tip": None,
        "rates": {"points_hz": 200.0}, "drops": {"lost": 3}, "temperatures": {"t1": 20.5},
        "calibration": "0123456789abcdef", "points": {"published": 1, "flagged": {}},
        "latency": {},
    } | changes  # fmt: skip


def test_an_arm_is_listed_while_its_token_stands() -> None:
    now = [0.0]
    fleet = Fleet(lambda: now[0])
    fleet.note_health("B", health("B"))
    assert fleet.rows() == []
    for serial in "BA":
        fleet.note_token(serial, True)
    fleet.note_health("A", health("A", state="WARMING"))
    assert [(row["serial"], row["state"]) for row in fleet.rows()] == [
        ("A", "WARMING"),
        ("B", "READY"),
    ]
    assert fleet.rows()[1] | {"reason": 0, "tip": 0, "stamp_ns": 0} == {
        "serial": "B", "state": "READY", "points_hz": 200.0, "lost": 3,
        "temperatures": {"t1": 20.5}, "calibration": "0123456789abcdef",
        "reason": 0, "tip": 0, "stamp_ns": 0,
    }  # fmt: skip
    now[0] = 3.5
    fleet.note_health("A", health("A"))
    assert [(row["state"], row["points_hz"]) for row in fleet.rows()] == [
        ("READY", 200.0),
        ("NOT_READY", 0.0),
    ]
    fleet.note_token("A", False)
    assert [row["serial"] for row in fleet.rows()] == ["B"]
    fleet.note_token("A", True)  # anew: nothing old is told of it
    assert [row["serial"] for row in fleet.rows()] == ["B"]


def router(endpoint: str) -> AbstractContextManager[zenoh.Session]:
    return session("router", endpoint, **{"transport/link/tx/queue/size/data": 16})


def arm_with_daemon(
    stack: ExitStack, folder: Path, serial: str, plant: str, rate_hz: int = 200, seed: int = 1
) -> Any:
    """An arm whose daemon connects to the router at *plant*."""
    folder.mkdir()
    options = ("--serial-number", serial, "--seed", str(seed))
    arm = stack.enter_context(simulated_arm(folder, *options, rate_hz=rate_hz))
    extra = f'mode = "router"\nconnect = ["{plant}"]\n'
    return stack.enter_context(running_daemon(folder, arm.port, extra=extra, serial=serial))


@pytest.mark.slow
def test_two_arms_behind_a_router(tmp_path: Path) -> None:
    plant = free_endpoint()
    with ExitStack() as stack:
        stack.enter_context(router(plant))
        arm_with_daemon(stack, tmp_path / "a", "SIM-0001", plant)
        other = arm_with_daemon(stack, tmp_path / "b", "SIM-0002", plant)
        fleet = stack.enter_context(
            subprocess.Popen(
                [*ARMD, "fleet", "--endpoint", plant, "--json"], stdout=subprocess.PIPE, text=True
            )
        )
        stack.callback(fleet.kill)
        assert fleet.stdout is not None
        lines = (json.loads(line) for line in fleet.stdout)
        wanted = {"SIM-0001", "SIM-0002"}
        for line in lines:
            if line["points_hz"] > 100:
                wanted.discard(line["serial"])
            if not wanted:
                break
        assert set(line) >= {
            "serial", "state", "points_hz", "lost", "temperatures", "calibration",
        }  # fmt: skip
        with armd.connect("SIM-0001", plant) as arm:  # one of several, by the same router
            assert next(arm.points()).seq > 0
            assert arm.info()["arm"]["serial_number"] == "SIM-0001"
        other.stop()
        end_s = time.monotonic() + PATIENCE_S
        alone = 0
        for line in lines:
            alone = 0 if line["serial"] == "SIM-0002" else alone + 1
            if alone == 3:
                break
            assert time.monotonic() < end_s
        fleet.terminate()
        assert fleet.wait(60) == 0
        metrics = ["--endpoint", plant, "--metrics", "127.0.0.1:0"]
        with running_bridge("fleet", *metrics) as bridge:

            def metrics() -> str:
                with urllib.request.urlopen(f"http://{bridge.where}/metrics", timeout=60) as reply:
                    return str(reply.read().decode())

            wait_until(lambda: 'armd_points_total{serial="SIM-0001"}' in metrics())
            assert bridge.stop() == 0


@pytest.mark.slow
def test_two_daemons_of_one_serial_are_told(tmp_path: Path) -> None:
    plant = free_endpoint()
    with ExitStack() as stack:
        stack.enter_context(router(plant))
        arm_with_daemon(stack, tmp_path / "a", "SIM-0001", plant)
        arm = stack.enter_context(armd.connect("SIM-0001", plant))
        assert "two_daemons" not in {event["kind"] for event in arm.events(1.5)}
        arm_with_daemon(stack, tmp_path / "b", "SIM-0001", plant)
        told = (e for e in arm.events(PATIENCE_S) if e["kind"] == "two_daemons")
        event = next(told)
        assert event["severity"] == "error"
        assert "another daemon publishes as SIM-0001" in event["text"]


# --- the example's rules -----------------------------------------------------------------------


def configuration(name: str, folder: Path, **replaced: str) -> Path:
    text = (EXAMPLES / f"{name}.json5").read_text(encoding="utf-8")
    for old, new in {"/etc/armd/tls": str(folder), **replaced}.items():
        assert old in text
        text = text.replace(old, new)
    path = folder / f"{name}-{len(list(folder.iterdir()))}.json5"
    path.write_text(text, encoding="utf-8")
    return path


def test_an_arm_speaks_for_itself_alone(tmp_path: Path) -> None:
    authority = trustme.CA()
    authority.cert_pem.write_to_path(tmp_path / "ca.pem")
    for name in ("router", "SIM-0001", "SIM-0002", "inspection"):
        write_certificate(authority, tmp_path, name, "localhost")
    port = free_endpoint().rpartition(":")[2]
    router_file = configuration("plant-router", tmp_path, **{"0.0.0.0:7447": f"127.0.0.1:{port}"})
    place = {"router.example:7447": f"localhost:{port}", "127.0.0.1:7447": "127.0.0.1:0"}

    def arm(name: str) -> zenoh.Session:
        own = {"arm.key": f"{name}.key", "arm.pem": f"{name}.pem"}
        return zenoh.open(
            zenoh.Config.from_file(str(configuration("plant-arm", tmp_path, **place, **own)))
        )

    text = (EXAMPLES / "client.json5").read_text(encoding="utf-8")
    text = text.replace("controller.example:7448", f"localhost:{port}")
    text = text.replace("ca.pem", f"{tmp_path}/ca.pem")
    text = text.replace('"inspection.', f'"{tmp_path}/inspection.')
    (tmp_path / "viewer.json5").write_text(text, encoding="utf-8")
    heard: list[str] = []
    intruders: list[str] = []
    with (
        running_bridge("fleet", "--router", str(router_file)) as plant,
        arm("SIM-0001") as first,
        arm("SIM-0002") as second,
        zenoh.open(zenoh.Config.from_file(str(tmp_path / "viewer.json5"))) as eyes,
    ):
        eyes.declare_subscriber(
            "armd/*/point",
            lambda sample: heard.append(sample.payload.to_string()),
            allowed_origin=zenoh.Locality.REMOTE,
        )
        first.declare_subscriber(
            "armd/SIM-0001/point",
            lambda sample: intruders.append(sample.payload.to_string()),
            allowed_origin=zenoh.Locality.REMOTE,
        )
        end_s = time.monotonic() + PATIENCE_S
        while not {"1 as 1", "2 as 2"} <= set(heard):
            assert time.monotonic() < end_s, heard
            for k, session in ((1, first), (2, second)):
                for claimed in (1, 2):
                    session.put(f"armd/SIM-000{claimed}/point", f"{k} as {claimed}")
            eyes.put("armd/SIM-0001/point", "a viewer as 1")
            time.sleep(0.1)
        time.sleep(0.5)
        assert set(heard) == {"1 as 1", "2 as 2"}
        assert intruders == []
        assert plant.ready.endswith(str(router_file))


def test_an_arm_in_a_plant_relays_no_key_between_its_guests(tmp_path: Path) -> None:
    """Nor those that no wildcard matches."""
    authority = trustme.CA()
    authority.cert_pem.write_to_path(tmp_path / "ca.pem")
    write_certificate(authority, tmp_path, "SIM-0001", "localhost", "arm")
    own, nobody = free_endpoint(), free_endpoint().rpartition(":")[2]
    place = {"router.example:7447": f"localhost:{nobody}", "tcp/127.0.0.1:7447": own}
    keys = ["armd/SIM-0001/@x", "armd/SIM-0001/@x/y", "@armd/x", "armd/TWIN/point", "other/program"]
    relayed: list[str] = []
    asked: list[str] = []
    with (
        zenoh.open(
            zenoh.Config.from_file(str(configuration("plant-arm", tmp_path, **place)))
        ) as arm,
        session_with(own) as listener,
        session_with(own) as speaker,
    ):
        answer = arm.declare_queryable("armd/SIM-0001/info", lambda query: asked.append("info"))
        for key in keys:
            listener.declare_subscriber(key, lambda sample: relayed.append(str(sample.key_expr)))
        # A question to the arm passes.
        wait_until(lambda: (list(speaker.get("armd/SIM-0001/info", timeout=0.2)), asked)[1])
        for _ in range(20):
            for key in keys:
                speaker.put(key, b"x")
            time.sleep(0.02)
        answer.undeclare()
    assert relayed == []


# --- many --------------------------------------------------------------------------------------


@pytest.mark.crowd
@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("arms", [6, long_case(20)])
def test_many_arms_through_one_router(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arms: int
) -> None:
    """Simulated arms with a daemon each at 200 Hz: what they publish arrives, every point. At what
    rate each arm got its two processes' share of the machine is printed."""
    seconds, plant = 20.0, free_endpoint()
    with ExitStack() as stack:
        reader = stack.enter_context(router(plant))
        payloads: dict[str, list[bytes]] = {}

        def take(sample: zenoh.Sample) -> None:
            serial = str(sample.key_expr).split("/")[1]
            payloads.setdefault(serial, []).append(sample.payload.to_bytes())

        reader.declare_subscriber("armd/*/point", take)
        for k in range(arms):
            serial = f"SIM-{k:04d}"
            arm_with_daemon(stack, tmp_path / serial, serial, plant, seed=k + 1)
        wait_until(lambda: len(payloads) == arms, payloads.keys())
        starts = {serial: len(heard) for serial, heard in payloads.items()}
        time.sleep(seconds)
        lost, upstream, rates = 0, 0, []
        for serial, heard in payloads.items():
            points = np.frombuffer(b"".join(heard[starts[serial] :]), POINT)
            counted = Lost()
            counted.count(points)
            lost += counted.here
            upstream += counted.upstream
            rates.append(len(points) / seconds)
        with capsys.disabled():
            print(
                f"\n{arms} arms, {seconds:g} s: {sum(rates):.0f} points/s through one router, "
                f"{min(rates):.0f} to {max(rates):.0f} Hz an arm; "
                f"{lost} lost on the way, {upstream} before their daemons"
            )
        assert lost == 0
        assert min(rates) > 0
