"""The shop-floor example: who may connect, see and command, by certificate."""

from __future__ import annotations

import socket
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
from armd.daemon.publisher import Publisher
from armd.daemon.queries import Queries
from armd.daemon.session import open_session
from armd.drivers.sample import RawFrame
from armd.simulator.truth.nominal import arm_toml

EXAMPLES = Path(__file__).resolve().parents[2] / "deploy/zenoh"
SERIAL = "SIM-0001"
ARMD_TOML = """\
schema = "armd.daemon/1"
arm = "arm.toml"
[driver]
kind = "serial"
port = "/dev/armd/SIM-0001"
[zenoh]
config = "shop-floor.json5"
"""


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def write_certificate(authority: trustme.CA, folder: Path, name: str, host: str) -> None:
    """*name*.pem and *name*.key, as docs/secure.md makes them with openssl."""
    certificate = authority.issue_cert(host, common_name=name)
    certificate.private_key_pem.write_to_path(folder / f"{name}.key")
    chain = b"".join(part.bytes() for part in certificate.cert_chain_pems)
    (folder / f"{name}.pem").write_bytes(chain)


class Floor:
    """A daemon's session as the example configures it, on ports and with certificates of ours."""

    def __init__(self, folder: Path, cleanup: ExitStack) -> None:
        self.folder = folder
        self.tls, self.tcp = free_port(), free_port()
        authority = trustme.CA()
        authority.cert_pem.write_to_path(folder / "ca.pem")
        write_certificate(authority, folder, "controller", "localhost")
        for name in ("inspection", "operator", "stranger"):
            write_certificate(authority, folder, name, f"{name}.example")
        write_certificate(trustme.CA(), folder, "intruder", "intruder.example")
        text = (EXAMPLES / "shop-floor.json5").read_text()
        text = text.replace("0.0.0.0:7447", f"127.0.0.1:{self.tls}")
        text = text.replace("127.0.0.1:7447", f"127.0.0.1:{self.tcp}")
        text = text.replace("/etc/armd/tls", str(folder))
        (folder / "shop-floor.json5").write_text(text)
        (folder / "arm.toml").write_text(arm_toml(SERIAL))
        (folder / "armd.toml").write_text(ARMD_TOML)
        session = cleanup.enter_context(open_session(load_config(folder / "armd.toml")))
        publisher = cleanup.enter_context(closing(Publisher(session, SERIAL)))
        publisher.events.put({"kind": "test"})
        commands = {"reload": lambda _: "reloaded"}
        info = {"arm": SERIAL}
        frame = RawFrame(1, 2, "rx", b"bytes")
        queries = Queries(session, SERIAL, publisher, lambda: info, lambda: [frame], commands)
        over = threading.Event()

        def answer() -> None:
            while not over.wait(0.01):
                queries.answer()
                publisher.put_health({"state": "READY"})
                publisher.look_for_listeners()
                publisher.put_raw([frame])

        thread = threading.Thread(target=answer)
        cleanup.callback(thread.join)
        cleanup.callback(over.set)
        thread.start()

    def client(self, name: str) -> str:
        """The configuration file of the client *name*."""
        text = (EXAMPLES / "client.json5").read_text()
        text = text.replace("controller.example:7447", f"localhost:{self.tls}")
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
        assert arm.info() == {"arm": SERIAL}
        assert next(arm.health(10.0)) == {"state": "READY"}
        assert next(arm.events(10.0)) == {"kind": "test"}
        with pytest.raises(armd.ArmdError):
            arm.command("reload")


def test_an_operator_may_command(floor: Floor) -> None:
    with armd.connect(endpoint=floor.client("operator")) as arm:
        assert arm.command("reload") == "reloaded"


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


def test_the_controller_itself_needs_no_certificate(floor: Floor) -> None:
    with armd.connect(endpoint=f"tcp/127.0.0.1:{floor.tcp}") as arm:
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
