"""`armd view`: who may look and do, what a page is told, and pages that stall."""

from __future__ import annotations

import asyncio
import json
import math
import re
import socket
import ssl
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager, suppress
from functools import wraps
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trustme
from hypothesis import given
from hypothesis import strategies as st

from armd import POINT, Flag
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import name_constants
from armd.daemon.bridges.listening import open_listener
from armd.daemon.bridges.view import page_messages
from armd.daemon.bridges.view.access import Access, read_token
from armd.daemon.bridges.view.board import KEPT, MOST_BYTES, Board
from armd.daemon.bridges.view.features import fit_feature
from armd.daemon.bridges.view.files import Files
from armd.daemon.bridges.view.history import TemperatureHistory
from armd.daemon.bridges.view.http import MOST_HEAD_BYTES, NotServed, parse
from armd.daemon.bridges.view.server import SEND_BUFFER_BYTES, PageServer
from armd.daemon.bridges.view.sessions import list_results
from armd.daemon.cli import main
from armd.daemon.files.tip_history import keep
from armd.errors import ArmdError, BadInput
from armd.simulator.truth.nominal import make_arm_toml

NOWHERE = "tcp/127.0.0.1:1"  # where no daemon is
TOKEN = "correct-horse-battery"


# --- what pages are told ---------------------------------------------------------------------


def test_a_page_reads_the_latest_of_some_topics_and_every_one_of_others() -> None:
    board = Board()
    for k in range(3):
        board.put("live", str(k))
        board.append("event", str(k))
    said, read = board.since(0)
    assert said.decode().split("\n\n")[:-1] == [
        f"event: {topic}\ndata: {k}" for topic, k in
        [("event", 0), ("event", 1), ("live", 2), ("event", 2)]
    ]  # fmt: skip
    assert board.since(read) == (b"", read)


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 30_000)), max_size=60), st.data())
def test_whoever_reads_seldom_misses_no_event_and_gets_no_more_than_a_part_at_once(
    steps: list[tuple[bool, int]], data: st.DataObject
) -> None:
    board, read, heard, latest = Board(), 0, [], None
    for k, (every, length) in enumerate(steps):
        (board.append if every else board.put)("x", json.dumps([every, k, "." * length]))
        if data.draw(st.booleans()):
            said, read = board.since(read)
            assert len(said) < MOST_BYTES + 31_000
            heard += _messages(said)
        latest = latest if every else k
    while read < board.version:
        said, read = board.since(read)
        heard += _messages(said)
    assert [k for every, k, _ in heard if every] == [
        k for k, (every, _) in enumerate(steps) if every
    ]
    assert latest is None or [k for every, k, _ in heard if not every][-1] == latest


def _messages(said: bytes) -> list[Any]:
    return [json.loads(line[6:]) for line in said.decode().split("\n") if line.startswith("data: ")]


def test_a_board_holds_a_bounded_past() -> None:
    board = Board()
    for k in range(KEPT + 5):
        board.append("event", str(k))
    read, heard = 0, []
    while read < board.version:
        said, read = board.since(read)
        heard += _messages(said)
    assert heard == list(range(5, KEPT + 5))


def test_a_point_is_told_to_the_last_bit_and_an_invalid_one_has_no_position() -> None:
    points = np.zeros(2, POINT)
    points["position_mm"] = [[1 / 3, -2e-17, 1e3], [np.nan] * 3]
    points["covariance_mm2"] = [[1e-4, 0, 0, 4e-4, 0, 9e-4], [np.nan] * 6]
    points["flags"] = [0, Flag.INVALID]
    valid, invalid = (
        json.loads(page_messages.format_live(point, [0.5, math.nan])) for point in points
    )
    assert valid["p"] == points["position_mm"][0].tolist()
    assert valid["u"] == pytest.approx([0.01, 0.02, 0.03], rel=1e-6)
    assert valid["q"] == [0.5, None]
    assert (invalid["p"], invalid["u"], invalid["o"]) == (None, None, None)


def test_every_flag_has_words() -> None:
    flags = page_messages.describe_flags()
    assert [int(bit) for bit in flags] == [flag.bit_length() - 1 for flag in Flag]
    assert {flag["severity"] for flag in flags.values()} <= {"info", "warning", "error"}
    assert flags["0"]["text"].startswith("Position is NaN: ")


def test_the_geometry_is_the_calibrations_and_the_tips(tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    path.write_text(make_arm_toml())
    arm = load_arm(path)
    info = {
        "arm": arm.model_dump(mode="json", by_alias=True),
        "configuration": {"tips": {"long": {"offset_mm": [0, 1, 200], "radius_mm": None}}},
        "tip": None,
    }
    nominal = arm.nominal()
    drawn = page_messages.compute_geometry(info, None)
    assert np.allclose(drawn["rows"], nominal[:30].reshape(6, 5), atol=1e-15)
    identified = nominal + np.arange(39) * 1e-3
    calibration = {"constants": name_constants(identified, 6)}
    found = page_messages.compute_geometry(info, calibration)
    flat = [*np.ravel(found["rows"]), *found["tip"], *found["base"]]
    assert np.array_equal(flat, identified)
    assert page_messages.compute_geometry(info | {"tip": "long"}, calibration)["tip"] == [0, 1, 200]
    assert (
        page_messages.compute_geometry(info | {"tip": "long"}, calibration)["radius_mm"]
        == arm.tip.radius_mm
    )


def test_temperatures_of_an_hour_are_kept() -> None:
    history = TemperatureHistory()
    for second in range(5000):
        history.add({"stamp_ns": second * 10**9, "temperatures": {"t1": 20.0, "t2": None}})
    told_ = json.loads(history.text())
    assert told_["sensors"] == ["t1", "t2"]
    assert len(told_["rows"]) == 1800
    assert told_["rows"][-1][1:] == [20.0, None]
    history.add({"stamp_ns": 10**9, "temperatures": {"t1": 20.0, "t2": None}})  # clock set back
    assert len(json.loads(history.text())["rows"]) == 1


def test_features_through_what_was_picked() -> None:
    measured = {
        str(k): {"position_mm": place, "covariance_mm2": [1e-4, 0, 0, 1e-4, 0, 1e-4]}
        for k, place in enumerate(
            [
                [0.0, 0.0, 5.0],
                [10.0, 0.0, 5.0],
                [0.0, 10.0, 5.0],
                [10.0, 10.0, 5.0],
                [3.0, 4.0, 25.0],
            ]
        )
    }
    measured["none"] = {"position_mm": None, "covariance_mm2": None}
    plane = fit_feature(measured, {"of": "plane:0,1,2,3"})
    assert np.abs(plane["direction"]) == pytest.approx([0, 0, 1], abs=1e-9)
    assert plane["uncertainty_from"] == "points"
    related = fit_feature(measured, {"of": "plane:0,1,2,3", "and": "point:4"})
    assert related["distance"]["value"] == pytest.approx(20.0)
    assert related["angle"] is None
    for of in ("plane:0,1", "blob:0,1,2", "plane:0,1,none", "plane:0,1,9", ""):
        with pytest.raises(ArmdError):
            fit_feature(measured, {"of": of})


# --- who may look, who may do ----------------------------------------------------------------


def request(head: str) -> Any:
    return parse(head.replace("\n", "\r\n").encode() + b"\r\n\r\n")


@pytest.mark.parametrize(
    ("host", "ours"),
    [
        ("127.0.0.1:8470", True), ("localhost:8470", True), ("LOCALHOST", True),
        ("[::1]:8470", True),
        ("localhost:9000", True), ("arm.example:8470", True), ("ARM.example", True),
        ("evil.example", False), ("evil.example:8470", False), ("localhost.evil.example", False),
        ("127.0.0.1.evil.example", False), ("", False), ("[::1", False), ("0.0.0.0:8470", False),
        ("169.254.1.1", False), ("evil@localhost.example", False), ("2130706433", False),
    ],
)  # fmt: skip
def test_a_foreign_host_is_refused(host: str, ours: bool) -> None:
    access = Access(["arm.example"])
    asked = request(f"GET / HTTP/1.1\nHost: {host}")
    if ours:
        access.check_host(asked)
    else:
        with pytest.raises(NotServed, match="Host"):
            access.check_host(asked)


def test_what_does_something_comes_from_our_own_page() -> None:
    access = Access()
    head = "POST /command/tip HTTP/1.1\nHost: localhost:8470"
    access.check_origin(request(head))
    access.check_origin(request(f"{head}\nOrigin: http://localhost:8470"))
    for line in (
        "Origin: http://evil.example",
        "Origin: null",
        "Origin: http://localhost:9999",
        "Sec-Fetch-Site: cross-site",
        "Sec-Fetch-Site: same-site",
    ):
        with pytest.raises(NotServed):
            access.check_origin(request(f"{head}\n{line}"))


def test_the_token_opens_as_header_and_as_cookie() -> None:
    access = Access(token=TOKEN, secure=True)
    cookie = access.cookie_header().split(";")[0]
    assert TOKEN not in cookie
    assert "Secure" in access.cookie_header()
    known = [f"Authorization: Bearer {TOKEN}", f"Cookie: other=1; {cookie}"]
    strange = [
        "X: y",
        "Authorization: Bearer wrong",
        f"Cookie: armd_view={TOKEN}",
        "Cookie: armd_view=",
    ]
    for line, opens in [(line, True) for line in known] + [(line, False) for line in strange]:
        assert access.knows(request(f"GET / HTTP/1.1\nHost: x\n{line}")) == opens, line
    assert Access().knows(request("GET / HTTP/1.1\nHost: x"))


@pytest.mark.parametrize("text", ["short", "two words of some length", "é" * 20, ""])
def test_a_poor_token_is_told(tmp_path: Path, text: str) -> None:
    path = tmp_path / "token"
    path.write_text(text, encoding="utf-8")
    path.chmod(0o600)
    with pytest.raises(BadInput, match="token"):
        read_token(path)
    path.write_text(TOKEN + "\n")
    assert read_token(path) == TOKEN
    path.chmod(0o644)
    with pytest.raises(BadInput, match="mode"):
        read_token(path)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--listen", "0.0.0.0:8470"], "without --certificate"),
        (["--listen", "arm.example:8470"], "without --certificate"),
        (["--certificate", "x.pem"], "expected both"),
    ],
)
def test_onto_the_network_only_with_certificate_and_token(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", *words]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    "head",
    [b"GET /\r\n\r\n", b"\r\n\r\n", b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
     b"GET http://[ HTTP/1.1\r\n\r\n", b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 200 + b"\r\n"],
)  # fmt: skip
def test_what_is_no_request_is_refused(head: bytes) -> None:
    with pytest.raises(NotServed):
        parse(head)


@given(st.binary(max_size=200))
def test_any_bytes_are_a_request_or_refused(head: bytes) -> None:
    with suppress(NotServed):
        parse(head + b"\r\n\r\n")


# --- the page's files ------------------------------------------------------------------------


def test_the_page_asks_nobody_else() -> None:
    """No address of another host in any file, but names of namespaces and licences."""
    folder = Path(str(resources.files("armd.daemon.bridges.view") / "page"))
    for path in folder.rglob("*"):
        if path.suffix in (".js", ".css", ".html"):
            found = set(re.findall(r"https?://[\w.]+", path.read_text(encoding="utf-8")))
            assert found <= {"http://www.w3.org"}, path
            assert "@import" not in path.read_text(encoding="utf-8")


def test_every_import_and_link_of_the_page_is_there() -> None:
    files = Files()
    folder = Path(str(resources.files("armd.daemon.bridges.view") / "page"))
    for path in [*folder.glob("*.js"), *folder.glob("*.html")]:
        text = path.read_text(encoding="utf-8")
        for target in re.findall(r'(?:from |src=|href=)"(\.?/[\w./-]+\.(?:js|css|svg))"', text):
            assert files.get("/" + target.lstrip("./")) is not None, (path, target)
    for library in ("three", "uplot"):
        assert files.get(f"/vendor/{library}-LICENSE.txt") is not None
    assert all(f'id="{name}"' in (folder / "index.html").read_text() for name in
               set(re.findall(r'\$\("([\w-]+)"\)', (folder / "main.js").read_text())))  # fmt: skip


def test_nothing_in_the_page_is_written_as_markup() -> None:
    """What a daemon or a person named shall not become a script."""
    folder = Path(str(resources.files("armd.daemon.bridges.view") / "page"))
    for path in folder.glob("*.js"):
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|eval\(", text)
    for path in folder.glob("*.html"):
        assert not re.search(r"\son\w+=|style=|<script>|<style", path.read_text(encoding="utf-8"))


# --- the server, without a daemon ------------------------------------------------------------


def in_a_loop(scenario: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """A test of asyncio as pytest runs it."""

    @wraps(scenario)
    def run(*arguments: Any, **named: Any) -> None:
        asyncio.run(scenario(*arguments, **named))

    return run


@asynccontextmanager
async def serving(
    access: Access | None = None, sessions: Path | None = None, tls: ssl.SSLContext | None = None
) -> AsyncIterator[tuple[PageServer, int]]:
    server = PageServer(access or Access(), None, NOWHERE, sessions)
    listening, where = await open_listener(("127.0.0.1", 0), server._connection, tls)
    async with listening:
        yield server, int(where.rpartition(":")[2])


async def ask(
    port: int, head: str, body: bytes = b"", tls: ssl.SSLContext | None = None
) -> tuple[int, dict[str, str], bytes]:
    name = "localhost" if tls else None
    reader, writer = await asyncio.open_connection("127.0.0.1", port, ssl=tls, server_hostname=name)
    length = f"\r\nContent-Length: {len(body)}" if body else ""
    writer.write(head.replace("\n", "\r\n").encode() + length.encode() + b"\r\n\r\n" + body)
    async with asyncio.timeout(20):
        told_, _, rest = (await reader.read()).partition(b"\r\n\r\n")
    writer.close()
    line, *fields = told_.decode().split("\r\n")
    return int(line.split()[1]), dict(field.split(": ", 1) for field in fields), rest


@in_a_loop
async def test_what_is_asked_is_answered_under_guard() -> None:
    async with serving() as (_, port):
        host = f"Host: localhost:{port}"
        status, headers, body = await ask(port, f"GET / HTTP/1.1\n{host}")
        assert (status, b"<title>armd" in body) == (200, True)
        policy = headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "script-src 'self';" in policy
        assert "frame-ancestors 'none'" in policy
        assert not re.search("unsafe|http|\\*", policy)
        assert headers["X-Content-Type-Options"] == "nosniff"
        tag = f"If-None-Match: {headers['ETag']}"
        assert (await ask(port, f"GET / HTTP/1.1\n{host}\n{tag}"))[0] == 304
        status, headers, body = await ask(
            port, f"GET /vendor/three.js HTTP/1.1\n{host}\nAccept-Encoding: gzip, br"
        )
        assert (status, headers["Content-Encoding"]) == (200, "gzip")
        assert len(body) < 250_000
        for path, status in {
            "/../server.py": 404, "/%2e%2e/server.py": 404, "/vendor/": 404, "/nothing": 404,
            "/measurements.csv": 503, "/measurements.exe": 404, "/temperatures": 200,
            "/feature?of=plane:1,2,3": 409, "/feature": 409,
        }.items():  # fmt: skip
            assert (await ask(port, f"GET {path} HTTP/1.1\n{host}"))[0] == status, path
        for foreign in ("Host: evil.example", "X: no host at all"):
            for path in ("/", "/events", "/measurements.csv", "/style.css"):
                status, headers, _ = await ask(port, f"GET {path} HTTP/1.1\n{foreign}")
                assert (status, "Content-Security-Policy" in headers) == (403, True), path
        assert (await ask(port, f"DELETE / HTTP/1.1\n{host}"))[0] == 405
        for digits in (12, 13, 5000):
            head = f"POST /login HTTP/1.1\n{host}\nContent-Length: {'9' * digits}"
            assert (await ask(port, head))[0] == 413
        assert (await ask(port, f"GET / HTTP/1.1\n{host}\nA: {'x' * MOST_HEAD_BYTES}"))[0] == 431


def test_results_of_a_session_are_read_and_nothing_beside_them(tmp_path: Path) -> None:
    session = tmp_path / "sessions" / "beam in May"
    session.mkdir(parents=True)
    (session / "calibrate.html").write_text("<h1>report</h1><script>alert(1)</script>")
    (session / "session.toml").write_text("arm = 1")
    (session / ".hidden.html").write_text("no")
    (session / "measuring.jsonl").write_text("no")
    (session / "link.html").symlink_to("/etc/passwd")
    (tmp_path / "secret.html").write_text("no")
    (tmp_path / "sessions" / "away").symlink_to(tmp_path)
    (tmp_path / "sessions" / "fifo.html").mkdir()

    async def scenario() -> None:
        async with serving(Access(token=TOKEN), sessions=session.parent) as (_, port):
            host = f"Host: localhost:{port}\nAuthorization: Bearer {TOKEN}"
            way = "/sessions/beam%20in%20May/calibrate.html"
            status, headers, body = await ask(port, f"GET {way} HTTP/1.1\n{host}")
            assert (status, body[:15]) == (200, b"<h1>report</h1>")
            # Whoever named an artefact after a script has it read as text.
            policy = headers["Content-Security-Policy"]
            assert policy.startswith("sandbox; default-src 'none'")
            assert "script" not in policy and "allow" not in policy
            assert (await ask(port, f"GET {way} HTTP/1.1\nHost: localhost:{port}"))[0] == 401
            for path in (
                "beam%20in%20May/.hidden.html", "beam%20in%20May/measuring.jsonl",
                "beam%20in%20May/link.html", "away/secret.html", "../secret.html",
                "%2e%2e/secret.html", "beam%20in%20May/..%2f..%2fsecret.html", "fifo.html/a.html",
                "beam%20in%20May/", "beam%20in%20May", "", "beam%20in%20May/no.html",
            ):  # fmt: skip
                asked = f"GET /sessions/{path} HTTP/1.1\n{host}"
                assert (await ask(port, asked))[0] == 404, path
        async with serving() as (_, port):  # one that only looks knows of no sessions
            asked = f"GET {way} HTTP/1.1\nHost: localhost:{port}"
            assert (await ask(port, asked))[0] == 404

    asyncio.run(scenario())
    found = [file["name"] for file in list_results(session)]
    assert found == ["calibrate.html", "session.toml"]


@in_a_loop
async def test_the_history_of_tips_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    server = PageServer(Access(), "SIM-0001", NOWHERE, None)
    listening, where = await open_listener(("127.0.0.1", 0), server._connection)
    port = int(where.rpartition(":")[2])
    async with listening:
        asked = f"GET /tips HTTP/1.1\nHost: localhost:{port}"
        assert (await ask(port, asked))[2] == b"[]"
        keep("SIM-0001", {"name": "ruby", "verdict": "good"})
        keep("SIM-0002", {"name": "another arm's"})
        told_ = json.loads((await ask(port, asked))[2])
        assert [tip["name"] for tip in told_] == ["ruby"]


def test_the_server_says_what_flags_mean_and_ends_in_silence(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Before any arm is known; and without a traceback while a browser is connected."""

    browser = socket.socket()
    browser.setblocking(False)

    async def scenario() -> None:
        loop = asyncio.get_running_loop()
        async with serving() as (server, port):
            await loop.sock_connect(browser, ("127.0.0.1", port))
            head = f"GET /events HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n"
            await loop.sock_sendall(browser, head.encode())
            received = b""
            while b"\n\n" not in received.partition(b"data: ")[2]:
                received += await loop.sock_recv(browser, 1 << 16)
            hello = json.loads(received.partition(b"data: ")[2].partition(b"\n")[0])
            assert hello["flags"]["1"]["title"] == "Outside calibrated temperatures"
            assert len(server.transports) == 1
        # asyncio.run ends what is left, as SIGTERM does

    with browser:
        asyncio.run(scenario())
    assert caplog.text == ""


@in_a_loop
async def test_nothing_writes_unless_it_is_allowed() -> None:
    json_ = "Content-Type: application/json"
    async with serving() as (_, port):
        head = f"POST /command/tip HTTP/1.1\nHost: localhost:{port}\n{json_}"
        assert (await ask(port, head, b'{"name": ""}'))[0] == 403
    async with serving(sessions=Path("nowhere")) as (_, port):
        host = f"Host: localhost:{port}"
        head = f"POST /command/tip HTTP/1.1\n{host}\n{json_}"
        status, _, body = await ask(port, head, b'{"name": ""}')
        assert (status, json.loads(body)) == (409, {"error": "the daemon is not there"})
        for malformed in (b"{", b"[1]", b"3", b"[" * 30_000, b'{"a":' * 10_000):
            assert (await ask(port, head, malformed))[0] == 400
            assert (await ask(port, head.replace("command/tip", "guided/begin"), malformed))[
                0
            ] == 400
        assert (await ask(port, head, b"{}"))[0] == 400
        form = f"POST /command/tip HTTP/1.1\n{host}\nContent-Type: text/plain"
        assert (await ask(port, form, b'{"name": ""}'))[0] == 415
        foreign = f"{head}\nOrigin: http://evil.example"
        assert (await ask(port, foreign, b'{"name": ""}'))[0] == 403
        other = f"POST /command/accept HTTP/1.1\n{host}\n{json_}"
        assert (await ask(port, other, b"{}"))[0] == 404


@in_a_loop
async def test_on_the_network_a_token_and_a_certificate() -> None:
    authority = trustme.CA()
    theirs = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    authority.issue_cert("localhost").configure_cert(theirs)
    ours = ssl.create_default_context()
    authority.configure_trust(ours)
    access = Access(["localhost"], TOKEN, secure=True)
    async with serving(access, sessions=Path("nowhere"), tls=theirs) as (_, port):
        host = f"Host: localhost:{port}"
        status, _, body = await ask(port, f"GET / HTTP/1.1\n{host}", tls=ours)
        assert (status, b"Token of this arm" in body) == (200, True)
        for path in ("/events", "/temperatures", "/measurements.csv", "/feature", "/guided"):
            assert (await ask(port, f"GET {path} HTTP/1.1\n{host}", tls=ours))[0] == 401, path
        post = f"POST /command/reload HTTP/1.1\n{host}\nContent-Type: application/json"
        assert (await ask(port, post, b"{}", ours))[0] == 401
        login = f"POST /login HTTP/1.1\n{host}\nOrigin: https://localhost:{port}"
        status, headers, _ = await ask(port, login, b"token=wrong", ours)
        assert (status, "Set-Cookie" in headers) == (303, False)
        status, headers, _ = await ask(port, login, f"token={TOKEN}".encode(), ours)
        assert (status, headers["Location"]) == (303, "/")
        flags = headers["Set-Cookie"]
        assert all(word in flags for word in ("HttpOnly", "Secure", "SameSite=Strict"))
        cookie = f"Cookie: {flags.split(';')[0]}"
        head = f"GET /temperatures HTTP/1.1\n{host}\n{cookie}"
        assert (await ask(port, head, tls=ours))[0] == 200
        _, _, body = await ask(port, f"GET / HTTP/1.1\n{host}\n{cookie}", tls=ours)
        assert b"To the read-out" in body
        with pytest.raises((OSError, IndexError)):  # without TLS nobody answers
            await ask(port, f"GET / HTTP/1.1\n{host}")


@in_a_loop
async def test_pages_that_stand_still_hold_up_nobody_and_hold_little() -> None:
    """Forty of them beside one that reads: it hears every tick, and memory stays where it was."""
    async with serving() as (server, port):
        stalled = []
        for _ in range(40):
            connection = socket.socket()
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
            connection.setblocking(False)
            await asyncio.get_running_loop().sock_connect(connection, ("127.0.0.1", port))
            connection.sendall(f"GET /events HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n".encode())
            stalled.append(connection)
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(f"GET /events HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n".encode())
        await reader.readuntil(b"event: hello")
        while len(server.transports) < 41:
            await asyncio.sleep(0.01)
        waited_s = []
        for k in range(60):
            server._board.put("live", json.dumps([k, "." * 20_000]))  # a second of many, each
            began = time.monotonic()
            async with asyncio.timeout(10):
                await reader.readuntil(f"[{k}, ".encode())
                await reader.readuntil(b"\n\n")
            waited_s.append(time.monotonic() - began)
        held = [t.get_write_buffer_size() for t in server.transports]
        assert sum(size > 0 for size in held) >= 40  # they do stand still
        assert max(held) <= SEND_BUFFER_BYTES + MOST_BYTES
        assert np.median(waited_s) < 5.0
        writer.close()
        for connection in stalled:
            connection.close()


@in_a_loop
async def test_silent_connections_keep_no_browser_out() -> None:
    """400 of them, more than are served at once; who is served stays."""
    async with serving() as (_, port):
        head = f"GET / HTTP/1.1\nHost: localhost:{port}"
        events = head.replace("GET /", "GET /events").replace("\n", "\r\n").encode()
        reader, looking = await asyncio.open_connection("127.0.0.1", port)
        looking.write(events + b"\r\n\r\n")
        await reader.readuntil(b"hello")
        silent = [await asyncio.open_connection("127.0.0.1", port) for _ in range(400)]
        began = asyncio.get_running_loop().time()
        for _ in range(3):
            assert (await ask(port, head))[0] == 200
        assert asyncio.get_running_loop().time() - began < 5.0
        assert not reader.at_eof()
        for _, writer in [*silent, (reader, looking)]:
            writer.close()


@in_a_loop
async def test_more_browsers_than_there_is_room_for_are_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("armd.daemon.bridges.view.server.MOST_LOOKING", 1)
    async with serving() as (_, port):
        head = f"GET /events HTTP/1.1\nHost: localhost:{port}"
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(head.replace("\n", "\r\n").encode() + b"\r\n\r\n")
        await reader.readuntil(b"hello")
        assert (await ask(port, head))[0] == 503
        writer.close()


def test_an_arm_that_nothing_can_trigger_is_told() -> None:
    """Servos have no button but one that is named; other arms have theirs."""
    servos = {"kind": "feetech", "trigger": None}
    by_button, by_rest = {"trigger": "button"}, {"trigger": "rest"}
    assert page_messages.find_trigger({"driver": servos, "measurement": by_button}) is None
    assert page_messages.find_trigger({"driver": servos, "measurement": by_rest}) == "rest"
    named = servos | {"trigger": {"id": 6, "pressed_below": 1000}}
    assert page_messages.find_trigger({"driver": named, "measurement": by_button}) == "button"
    serial = {"kind": "serial", "port": "/dev/ttyUSB0"}
    assert page_messages.find_trigger({"driver": serial, "measurement": by_button}) == "button"
