"""The shop-floor example: who may connect, see and command, by certificate."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest
import trustme
import zenoh

import armd
from armd import keys
from armd.daemon.config import load_config
from armd.daemon.network.publisher import Publisher
from armd.daemon.network.queries import Queries
from armd.daemon.network.session import open_session
from armd.daemon.unexpected import Unexpected
from armd.drivers.sample import RawFrame
from armd.simulator.truth.nominal import make_arm_toml
from support.careless_network import EVENT, HEALTH
from support.certificates import write_certificate
from support.running_daemon import free_endpoint

EXAMPLES = Path(__file__).resolve().parents[2] / "deploy/zenoh"
SERIAL = "SIM-0001"
INFO = {
    "arm": {"serial_number": SERIAL, "joint": [], "tip": {"offset_mm": [0, 0, 1], "radius_mm": 3}},
    "configuration": {"tips": {}}, "tip": None,
}  # fmt: skip
ARMD_TOML = """\
schema = "armd.daemon/1"
arm = "arm.toml"
[driver]
kind = "serial"
port = "/dev/armd/SIM-0001"
[zenoh]
config = "shop-floor.json5"
"""


class Floor:
    """A daemon's session as the example configures it, on ports and with certificates of ours."""

    def __init__(self, folder: Path, cleanup: ExitStack) -> None:
        self.folder = folder
        self.tls, self.tcp = (free_endpoint().rpartition(":")[2] for _ in range(2))
        authority = trustme.CA()
        authority.cert_pem.write_to_path(folder / "ca.pem")
        write_certificate(authority, folder, "controller", "localhost")
        for name in ("inspection", "operator", "stranger"):
            write_certificate(authority, folder, name, f"{name}.example")
        write_certificate(trustme.CA(), folder, "intruder", "intruder.example")
        text = (EXAMPLES / "shop-floor.json5").read_text()
        text = text.replace("0.0.0.0:7448", f"127.0.0.1:{self.tls}")
        text = text.replace("127.0.0.1:7447", f"127.0.0.1:{self.tcp}")
        text = text.replace("/etc/armd/tls", str(folder))
        (folder / "shop-floor.json5").write_text(text)
        (folder / "arm.toml").write_text(make_arm_toml(SERIAL))
        (folder / "armd.toml").write_text(ARMD_TOML)
        session = cleanup.enter_context(open_session(load_config(folder / "armd.toml")))
        publisher = cleanup.enter_context(closing(Publisher(session, SERIAL)))
        publisher.events.put(EVENT)
        commands = {"reload": lambda _, answer: answer("reloaded", True)}
        info = json.dumps(INFO)
        frame = RawFrame(1, 2, "rx", b"bytes")
        told = {keys.INFO: lambda: info}
        queries = Queries(session, SERIAL, publisher, told, lambda: [frame], commands, Unexpected())
        cleanup.callback(queries.close)
        over = threading.Event()

        def answer() -> None:
            while not over.wait(0.01):
                queries.answer()
                publisher.put_health(HEALTH)
                publisher.look_for_listeners()
                publisher.put_raw([frame])

        thread = threading.Thread(target=answer)
        cleanup.callback(thread.join)
        cleanup.callback(over.set)
        thread.start()

    def client(self, name: str) -> str:
        """The configuration file of the client *name*."""
        text = (EXAMPLES / "client.json5").read_text()
        text = text.replace("controller.example:7448", f"localhost:{self.tls}")
        text = text.replace("ca.pem", f"{self.folder}/ca.pem")
        text = text.replace('"inspection.', f'"{self.folder}/{name}.')
        file = self.folder / f"{name}.json5"
        file.write_text(text)
        return str(file)


@pytest.fixture(scope="module")
def floor(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Floor]:
    with ExitStack() as cleanup:
        yield Floor(tmp_path_factory.mktemp("floor"), cleanup)


def test_a_viewer_sees_and_may_not_command(floor: Floor) -> None:
    with armd.connect(endpoint=floor.client("inspection")) as arm:
        assert arm.info() == INFO
        assert next(arm.health(10.0)) == HEALTH
        assert next(arm.events(10.0)) == EVENT
        with pytest.raises(armd.ArmdError):
            arm.command("reload")


def test_an_unknown_name_sees_nothing(floor: Floor) -> None:
    """A certificate of our own authority, but of nobody the configuration names."""
    with pytest.raises(armd.ArmdError):
        armd.connect(endpoint=floor.client("stranger"), timeout_s=2.0)
    with zenoh.open(zenoh.Config.from_file(floor.client("stranger"))) as session:
        health = session.declare_subscriber("armd/**", zenoh.handlers.FifoChannel(10))
        replies = session.get(f"armd/{SERIAL}/command/reload", timeout=1.0)
        assert [reply for reply in replies if reply.ok is not None] == []
        assert health.try_recv() is None


@pytest.mark.parametrize("fault", ["another authority", "no certificate"])
def test_without_our_certificate_nobody_connects(floor: Floor, fault: str) -> None:
    file = Path(floor.client("intruder"))
    if fault == "no certificate":
        lines = file.read_text().splitlines()
        file.write_text("\n".join(line for line in lines if "connect_" not in line))
    with pytest.raises(armd.ArmdError, match="no daemon answers"):
        armd.connect(endpoint=str(file), timeout_s=2.0)


def test_an_operator_may_command_and_the_controller_itself_without_a_certificate(
    floor: Floor,
) -> None:
    for endpoint in (floor.client("operator"), f"tcp/127.0.0.1:{floor.tcp}"):
        with armd.connect(endpoint=endpoint) as arm:
            assert arm.command("reload") == "reloaded"


def test_only_the_controller_itself_may_record(floor: Floor) -> None:
    with armd.connect(endpoint=f"tcp/127.0.0.1:{floor.tcp}") as arm:
        assert len(arm.preamble()[1]) == 1
        with arm.stream(keys.RAW) as stream:
            assert b"bytes" in next(stream.follow(10.0))[0]
    with armd.connect(endpoint=floor.client("inspection")) as arm:
        with pytest.raises(armd.ArmdError):
            arm.preamble()
        with arm.stream(keys.RAW) as stream:
            assert list(stream.follow(1.0)) == []


#: In a network and with an /etc of its own, in which the names of the examples mean this machine:
#: files and ports are those that are shipped.
VERBATIM = """\
ip link set lo up 2>/dev/null || {python} -c "{up}"
mount --bind "$1/etc" /etc
cd "$1/client"
{python} -m armd.daemon.cli run /etc/armd/armd.toml --allow-root >"$1/out" 2>&1 &
daemon=$!
trap 'kill $daemon; wait $daemon' EXIT
for _ in $(seq 600); do
    if grep -q "armd: ready" "$1/out"; then break; fi
    if ! kill -0 $daemon 2>/dev/null; then cat "$1/out"; exit 1; fi
    sleep 0.1
done
{python} -m armd.daemon.cli status --json >"$1/local.json" || [ $? = 1 ]
{python} -m armd.daemon.cli status --json --endpoint client.json5 >"$1/remote.json" || [ $? = 1 ]
"""
UP = """\
import fcntl, socket, struct
with socket.socket() as s: fcntl.ioctl(s, 0x8914, struct.pack('16sh', b'lo', 0x49))"""


@pytest.mark.slow
def test_the_shipped_files_start_as_they_are_shipped(tmp_path: Path) -> None:
    if subprocess.run(["unshare", "-Urmn", "true"], check=False).returncode:
        pytest.skip("this machine lets nobody have a network of its own")
    etc, client = tmp_path / "etc", tmp_path / "client"
    tls = etc / "armd/tls"
    tls.mkdir(parents=True)
    client.mkdir()
    for name in ("ld.so.cache", "ld.so.conf", "passwd", "group", "nsswitch.conf", "localtime"):
        if (Path("/etc") / name).is_file():
            (etc / name).write_bytes((Path("/etc") / name).read_bytes())
    (etc / "hosts").write_text("127.0.0.1 localhost controller.example\n")
    authority = trustme.CA()
    for folder in (tls, client):
        authority.cert_pem.write_to_path(folder / "ca.pem")
    write_certificate(authority, tls, "controller", "controller.example")
    write_certificate(authority, client, "inspection", "inspection.example")
    (etc / "armd/shop-floor.json5").write_bytes((EXAMPLES / "shop-floor.json5").read_bytes())
    (client / "client.json5").write_bytes((EXAMPLES / "client.json5").read_bytes())
    (etc / "armd/arm.toml").write_text(make_arm_toml(SERIAL))
    (etc / "armd/armd.toml").write_text(ARMD_TOML)
    script = VERBATIM.format(python=sys.executable, up=UP.replace("\n", ";", 1).replace("\n", ""))
    done = subprocess.run(
        ["unshare", "-Urmn", "sh", "-euc", script, "sh", tmp_path],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, (done.stdout, done.stderr, (tmp_path / "out").read_text())
    for who in ("local", "remote"):
        assert json.loads((tmp_path / f"{who}.json").read_text())["serial"] == SERIAL
