"""Another program on the same machine cannot speak for the arm: not by points, health, events,
tokens or answers, nor fill the daemon's memory; who may listen can be left to file permissions.

The daemon is a process of its own, and so is the forger.
"""

import json
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

import armd
from armd.simulator.truth.nominal import make_arm_toml
from support.running_daemon import running_daemon, session_with
from support.waiting import PATIENCE_S

SERIAL = "SIM-0001"
FORGER = """
import json, sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", json.dumps(sys.argv[2]))
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
config.insert_json5("listen/endpoints", "[]")
config.insert_json5("scouting/multicast/enabled", "false")
arm = "armd/SIM-0001/"
health = json.dumps({"state": "READY", "reason": "FORGED"})
answer = lambda query: query.reply(arm + "info", json.dumps({"arm": "FORGED"}))
with zenoh.open(config) as session:
    tokens = [session.liveliness().declare_token(key) for key in (arm + "alive", "armd/TWIN/alive")]
    offers = [session.declare_queryable(key, answer) for key in (arm + "info", "armd/**", "**")]
    time.sleep(0.3)
    print("forging", flush=True)
    while True:
        for key in (arm + "point", "armd/*/point", "armd/**", "**", arm + "@raw"):
            session.put(key, bytes(136))
        for key in (arm + "health", arm + "event", arm + "measurement", "*/*/health"):
            session.put(key, health)
        session.delete(arm + "event")
        session.put(arm + "event/@adv/pub/x/1/_", health)
        session.put(arm + "@daemon", health)
        for key in (arm + "@x", arm + "@x/y", "@armd/x", "armd/TWIN/@other/@x", "armd/@x/**"):
            session.put(key, health)
        time.sleep(0.02)
"""


@pytest.fixture(scope="module")
def daemon(tmp_path_factory):
    folder = tmp_path_factory.mktemp("forgery")
    (folder / "arm.toml").write_text(make_arm_toml(SERIAL))
    with running_daemon(folder, str(folder / "no-port")) as running:
        yield running


@pytest.mark.parametrize("mode", ["client", "peer"])
def test_whatever_another_program_says_reaches_nobody(daemon, mode):
    command = [sys.executable, "-c", FORGER, daemon.endpoint, mode]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as forger:
        try:
            assert forger.stdout.readline() == "forging\n"
            with daemon.listen() as heard, armd.connect(endpoint=daemon.endpoint) as arm:
                assert arm.serial == SERIAL  # one arm, no twin
                with arm.stream("event") as events, arm.stream("@raw") as raw:
                    for _ in range(5):
                        assert arm.info()["arm"]["serial_number"] == SERIAL
                    told: list[dict[str, object]] = []
                    end_s = time.monotonic() + PATIENCE_S
                    # The one key that is open is for an alarm.
                    while not any(event["kind"] == "two_daemons" for event in told):
                        assert time.monotonic() < end_s, told
                        time.sleep(0.1)
                        told += [json.loads(payload) for payload in events.take()]
                    time.sleep(1.0)  # forged on and on meanwhile
                    assert raw.take() == []
                assert all("text" in event for event in told)
                assert not heard.payloads["point"]
                states = heard.json("health")
            assert states and all(state["reason"] != "FORGED" for state in states)
            assert arm.refused.malformed == arm.refused.foreign == 0
            assert forger.poll() is None
        finally:
            forger.kill()


def test_no_key_is_relayed_between_others(daemon):
    """Not those either that no wildcard matches; the daemon is nobody's hub."""
    keys = ["armd/SIM-0001/@x", "armd/SIM-0001/@x/y", "@armd/x", "armd/TWIN/@other/@x", "armd/@x/z"]
    keys += ["other/program", "armd/TWIN/point", "armd/SIM-0001/@raw", "@/x"]
    heard = []
    command = [sys.executable, "-c", FORGER, daemon.endpoint, "client"]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as forger,
        session_with(daemon.endpoint) as listener,
        session_with(daemon.endpoint) as speaker,
    ):
        try:
            assert forger.stdout.readline() == "forging\n"
            for key in keys:
                listener.declare_subscriber(key, lambda sample: heard.append(str(sample.key_expr)))
            offers = [
                speaker.declare_queryable(key, lambda query: heard.append("asked")) for key in keys
            ]
            time.sleep(0.3)
            for _ in range(20):
                for key in keys:
                    speaker.put(key, b"x")
                time.sleep(0.02)
            for key in set(keys) - {"armd/SIM-0001/@raw"}:  # the daemon's own answer
                assert not [reply for reply in listener.get(key, timeout=0.3) if reply.ok]
            assert len(offers) == len(keys)
        finally:
            forger.kill()
    assert heard == []


def test_a_message_of_200_mb_takes_no_memory(daemon):
    def resident_mb():
        status = Path(f"/proc/{daemon.process.pid}/status").read_text()
        return max(int(line.split()[1]) for line in status.splitlines() if "VmHWM" in line) / 1024

    before_mb = resident_mb()
    with session_with(daemon.endpoint) as session:
        session.put(f"armd/{SERIAL}/point", bytes(200 << 20))
        list(session.get(f"armd/{SERIAL}/info", payload=bytes(100 << 20), timeout=2.0))
    assert resident_mb() - before_mb < 50
    assert daemon.get("health")[0]


def test_silent_connections_keep_no_client_out(daemon):
    host, port = daemon.endpoint.removeprefix("tcp/").split(":")
    silent = [socket.create_connection((host, int(port))) for _ in range(150)]
    try:
        began = time.monotonic()
        with armd.connect(SERIAL, endpoint=daemon.endpoint, timeout_s=30.0):
            taken_s = time.monotonic() - began
    finally:
        for connection in silent:
            connection.close()
    assert taken_s < 4.0  # with Zenoh's own limits ten


@pytest.mark.slow
def test_a_unix_socket_lets_in_whom_its_file_lets_in(tmp_path):
    (tmp_path / "arm.toml").write_text(make_arm_toml(SERIAL))
    path = tmp_path / "armd.sock"
    endpoint = f"unixsock-stream/{path}"
    for _ in range(2):  # the first is killed and leaves its socket behind
        with running_daemon(tmp_path, str(tmp_path / "no-port"), endpoint=endpoint):
            assert path.stat().st_mode & 0o777 == 0o660
            with armd.connect(endpoint=endpoint) as arm:
                assert arm.info()["arm"]["serial_number"] == SERIAL
