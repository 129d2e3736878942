"""The doors by which foreign input comes in: each takes bytes, and must never raise.

A door's seeds are sound input; what is damaged of it may be refused in words or taken, whichever is
right, but no exception may leave it, no message may carry a control character or be longer than a
screen, and none may take long.
"""

from __future__ import annotations

import asyncio
import io
import json
import shutil
import unicodedata
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

from armd.daemon import cli

#: Exit codes that are answers; 70 is a fault of armd.
ANSWERS = (0, 1, 2)
MOST_LETTERS = 4000


class Fault(Exception):
    """What a door must never do."""


@dataclass(frozen=True)
class Door:
    """`enter(data)` raises on a fault."""

    name: str
    seeds: list[bytes]
    enter: Callable[[bytes], None]


def command(folder: Path, name: str, file: str, seed: bytes, *words: str) -> Door:
    """A command of armd's with a damaged *file* of a folder that holds the rest undamaged."""

    def enter(data: bytes) -> None:
        path = folder / file
        path.write_bytes(data)
        try:
            code, said = run([word.replace("@", str(folder) + "/") for word in words])
            if code == 2 and data == seed:
                raise Fault(f"refused: {said[-1000:]}")
        finally:
            path.write_bytes(seed)
            shutil.rmtree(folder / "out", ignore_errors=True)
            for output in folder.glob("out*"):
                if output.is_file():
                    output.unlink()

    return Door(name, [seed], enter)


def run(words: list[str], main: Callable[[list[str]], int] = cli.main) -> tuple[int, str]:
    """Its exit code and errors, in this process; raises `Fault` unless it ends as a command may."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            code = main(words)
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 2
    if code not in ANSWERS:
        raise Fault(f"exit {code}: {err.getvalue()[-2000:]}")
    check_printed(out.getvalue())
    check_message(err.getvalue())
    return code, err.getvalue()


def check_printed(text: str) -> None:
    """No control character, and no sign without an encoding, may reach a terminal."""
    if any(unicodedata.category(c) in ("Cc", "Cf", "Cs") and c not in "\n\t\r" for c in text):
        raise Fault(f"a control character reaches the terminal: {text[:500]!r}")


def check_message(text: str) -> None:
    check_printed(text)
    longest = max(map(len, text.splitlines()), default=0)
    if longest > MOST_LETTERS:
        raise Fault(f"a message of {longest} letters: {text[:200]!r}")


def page(folder: Path) -> Door:
    """Whatever a browser, or anybody else, sends to `armd view`."""
    from armd.daemon.bridges.listening import open_listener
    from armd.daemon.bridges.view.access import Access
    from armd.daemon.bridges.view.server import PageServer

    async def answer(data: bytes) -> None:
        faults: list[str] = []
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _, context: faults.append(repr(context)))
        server = PageServer(Access(), None, "tcp/127.0.0.1:9", folder)
        listening, where = await open_listener(("127.0.0.1", 0), server._connection)
        async with listening:
            reader, writer = await asyncio.open_connection(
                "127.0.0.1", int(where.rpartition(":")[2])
            )
            try:
                writer.write(data)
                writer.write_eof()
                async with asyncio.timeout(0.5):
                    await reader.read(1 << 20)
            except (OSError, TimeoutError):
                pass
            writer.close()
            await asyncio.sleep(0.01)
        if faults:
            raise Fault("; ".join(faults))

    head = b"Host: localhost\r\n"
    body = b'{"name": "ruby", "kind": "seats", "session": "x", "targets": "P1,P2"}'
    post = b"Content-Type: application/json\r\nContent-Length: %d\r\n\r\n" % len(body) + body
    seeds = [
        b"GET / HTTP/1.1\r\n" + head + b"\r\n",
        b"GET /events HTTP/1.1\r\n" + head + b"\r\n",
        b"GET /feature?of=plane:1,2,3 HTTP/1.1\r\n" + head + b"Cookie: armd_view=x\r\n\r\n",
        *(
            b"POST /%s HTTP/1.1\r\n" % path + head + post
            for path in (b"command/tip", b"guided/begin", b"guided/artefact", b"login")
        ),
    ]
    return Door("page", seeds, lambda data: asyncio.run(answer(data)))


def dme(folder: Path) -> Iterator[Door]:
    """Lines of an inspection host to `armd ippdme`, in both versions."""
    from bridges.dme_bench import Bench

    lines = (
        b"00001 StartSession()\n00002 SetCsyTransformation(PartCsy, 1, 2, 3, 10, 20, 30)\n"
        b"00003 SetCoordSystem(PartCsy)\n00004 OnPtMeasReport(X(),Y(),Z(),IJK(),ER(),Q())\n"
        b'00005 EnableUser()\n00006 SetProp(Tool.PtMeasPar.Speed(20))\n00007 FindTool("long")\n'
        b'E0008 OnMoveReportE(Time(1),Dis(20),X(),Y(),Z())\n00009 ChangeTool("Ball3")\n'
        b"00010 Get(X(),Y(),Z())\n00011 GetErrorInfo(0513)\n00012 EnumAllProp(Tool())\n"
        b'00013 SaveNamedCsyTransformation("a", 0, 0, 0, 0, 0, 0)\n00014 LoadCoordSystem("a")\n'
        b"00015 PtMeas(X(1),Y(2),Z(3),IJK(0,0,1))\n00016 ClearAllErrors()\n00017 EndSession()\n"
    )

    def enter(version: str) -> Callable[[bytes], None]:
        def type_lines(data: bytes) -> None:
            state = folder / "state"
            shutil.rmtree(state, ignore_errors=True)
            bench = Bench(folder, version)
            bench.type(*data.decode("latin-1").split("\n"))
            bench.press()
            bench.session.tick(1e9)
            saved = Bench(folder, version)
            if saved.machine.systems.lost is not None:
                raise Fault(f"a host made the saved state unreadable: {saved.machine.systems.lost}")

        return type_lines

    for version in ("1.4.3", "2.5"):
        yield Door(f"ippdme {version}", [lines], enter(version))

    def read_state(data: bytes) -> None:
        path = folder / "state" / "ippdme-S.json"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)
        Bench(folder).type("00001 StartSession()", "00002 ClearAllErrors()", "00003 Get(X())")

    saved = {
        "schema": "armd.ippdme/1", "selected": "PartCsy",
        "transformations": {"PartCsy": [1, 2, 3, 10, 20, 30]}, "named": {"a": [0, 0, 0, 0, 0, 0]},
    }  # fmt: skip
    yield Door("ippdme state", [json.dumps(saved).encode()], read_state)
