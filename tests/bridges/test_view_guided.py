"""Guided measuring on the page: its buttons do what the letters of `armd measure` do."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from armd.compensation.data.sessions.format import ArtefactFile
from armd.compensation.data.sessions.session import load_session
from armd.compensation.model.arm import Arm
from armd.daemon.bridges.view.board import Board
from armd.daemon.bridges.view.guided import Guided
from armd.daemon.bridges.view.http import NotServed, Request
from armd.daemon.measure.plan.kinds import make_plan
from armd.daemon.measure.plan.stations import KINDS, Wishes
from armd.errors import ArmdError, BadInput
from armd.files.schema import load_toml
from support.pressed import pressed
from support.small_arm_toml import ARM

BEGUN_NS = 1_800_000_000 * 10**9
SEATS = {"kind": "seats", "name": "seats 1", "targets": "S1, S2", "repeats": 2}


class Daemon:
    """As far as a guided measurement asks one."""

    serial = "SMALL-1"

    def __init__(self, arm: Arm) -> None:
        self._arm = arm

    def info(self) -> dict[str, Any]:
        return {
            "arm": self._arm.model_dump(mode="json", by_alias=True),
            "tip": None,
            "configuration": {"tips": {}, "measurement": {"trigger": "button"}},
        }

    def calibration_file(self) -> None:
        return None


class Feed:
    """Of the page, without a network."""

    def __init__(self, arm: Any) -> None:
        self.arm = arm
        self.stamp_ns = BEGUN_NS
        self.measured: Callable[[dict[str, Any]], None] = lambda measurement: None


def press(number: int, **changes: Any) -> dict[str, Any]:
    """One reading of an arm without sensors."""
    place = [500.0, 100.0 * (number % 2), 300.0]
    return pressed(number, position_mm=place, approach=None, temperatures_c={}) | changes


class Page:
    """What a browser does and is told."""

    def __init__(self, folder: Path) -> None:
        self.arm = Arm.model_validate_json(json.dumps(ARM))
        self.folder = folder / "sessions"
        self.board = Board()
        self.feed = Feed(Daemon(self.arm))
        self.guided = Guided(self.board, self.folder, self.feed)  # type: ignore[arg-type]

    async def do(self, deed: str, content: Any = None) -> dict[str, Any]:
        body = json.dumps(content or {}).encode()
        return await self.guided.do(Request("POST", f"/guided/{deed}", {}, {}, body))

    async def presses(self, *numbers: int, **changes: Any) -> None:
        for number in numbers:
            self.feed.measured(press(number, **changes))
        await self.guided._waiting.join()

    def told(self) -> dict[str, Any]:
        said, read = b"", 0
        while read < self.board.version:
            more, read = self.board.since(read)
            said += more
        lines = [line for line in said.decode().split("\n") if line.startswith("data: ")]
        told: dict[str, Any] = json.loads(lines[-1].removeprefix("data: "))
        return told


def on_page(tmp_path: Path, story: Callable[[Page], Awaitable[None]]) -> Page:
    async def run() -> Page:
        page = Page(tmp_path)
        working = asyncio.ensure_future(page.guided.run())
        await story(page)
        working.cancel()
        page.guided.close()
        return page

    return asyncio.run(run())


def test_a_measurement_from_the_beginning_to_a_stop_and_on(tmp_path: Path) -> None:
    async def story(page: Page) -> None:
        page.feed.measured(press(1))  # nobody has begun
        await page.do("begin", SEATS)
        state = page.told()["state"]
        assert (state["done"], state["wanted"], state["next"]["target"]) == (0, 4, "S1")
        await page.presses(-1)  # of the past
        await page.presses(1, trigger="rest")
        assert page.told()["state"]["taken"] == 0
        await page.presses(1, 2)
        told = page.told()
        assert (told["state"]["done"], told["outcome"]["event"]) == (2, "reading")
        await page.presses(3, count=0, position_mm=None)
        assert page.told()["outcome"]["reason"] == "invalid"
        await page.do("delete")
        assert page.told()["state"]["next"]["target"] == "S2"
        with pytest.raises(ArmdError, match="is being measured"):
            await page.do("begin", SEATS | {"name": "other"})
        await page.do("artefact", {"artefact_c": 20.5})
        await page.presses(4)
        await page.do("skip")
        await page.do("again")
        assert page.told()["state"]["next"]["target"] == "S2"
        await page.do("stop")
        assert page.told()["phase"] == "none"
        with pytest.raises(ArmdError, match="no guided measurement"):
            await page.do("delete")
        (there,) = page.guided.choices()["sessions"]
        assert there["name"] == "seats 1"
        paths = {"name": "session.toml", "path": "/sessions/seats%201/session.toml"}
        assert paths in there["results"]
        await page.do("resume", {"name": "seats 1"})
        assert page.told()["state"]["taken"] == 2

    page = on_page(tmp_path, story)
    session = load_session(page.folder / "seats 1", page.arm)
    assert [session.artefact.target_names[i] for i in session.target] == ["S1", "S2"]


BALLS = {"B1": [0.0, 0.0, 0.0], "B2": [120.0, 0.0, 0.0], "B3": [0.0, 90.0, 0.0]}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_the_terminals(tmp_path: Path, kind: str) -> None:
    """What the page begins is what `armd measure` would, station by station."""
    folder = tmp_path / "sessions"
    folder.mkdir()
    beam = '[artefact]\nname = "beam"\n' + "".join(
        f'[[artefact.target]]\nname = "{name}"\nposition_mm = {where}\n'
        for name, where in BALLS.items()
    )
    (folder / "beam.toml").write_text(beam)
    joints = ",".join(f"q{k}_deg" for k in range(1, len(ARM["joint"]) + 1))
    row = ",".join(["400.0", "0.0", "100.0", *["10.0"] * len(ARM["joint"])])
    (folder / "poses.csv").write_text(f"x_mm,y_mm,z_mm,{joints}\n{row}\n")
    artefact = {"artefact": "beam.toml"} if kind in ("artefact", "poses") else {}
    content = {"kind": kind, "name": kind, **artefact}
    content |= {"poses": "poses.csv"} if kind == "poses" else {}
    content |= {"tip": "ruby"} if kind == "tip" else {}

    async def story(page: Page) -> None:
        await page.do("begin", content)
        state = page.told()["state"]
        known = load_toml(folder / "beam.toml", ArtefactFile).artefact if artefact else None
        wishes = Wishes(poses=folder / "poses.csv" if kind == "poses" else None)
        plan = make_plan(kind, page.arm, known, wishes)  # type: ignore[arg-type]
        assert (state["kind"], state["wanted"]) == (kind, len(plan.stations))
        first = plan.stations[0]
        told = state["next"]["target"], state["next"]["placement"], state["next"]["how"]
        assert told == (first.target, first.placement, first.how)

    on_page(tmp_path, story)


@pytest.mark.parametrize("name", ["", "..", "../out", "a/b", ".hidden", "a\0b", "x" * 100, 5, None])
def test_no_name_leads_out_of_the_folder(tmp_path: Path, name: Any) -> None:
    async def story(page: Page) -> None:
        for key in ("name", "artefact", "mpe"):
            if key == "name" or name:
                with pytest.raises(BadInput, match=f"the page: {key}: found"):
                    await page.do("begin", SEATS | {key: name})
        with pytest.raises(BadInput):
            await page.do("resume", {"name": name})
        assert not page.folder.exists()

    on_page(tmp_path, story)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"kind": "nonsense"}, "kind: found 'nonsense'"),
        ({"repeats": 0}, "repeats: found 0"),
        ({"repeats": 2.5}, "repeats: found 2.5"),
        ({"repeats": "many"}, "repeats: found 'many'"),
        ({"near_mm": 0}, "near_mm: found 0, expected a number above 0"),
        ({"kind": "tip", "targets": "", "sphere_mm": -25.4}, "sphere_mm: found -25.4"),
        (
            {"kind": "verify", "targets": "", "tests": "spot", "repeats": ""},
            "--tests: found 'spot'",
        ),
        ({"kind": "artefact"}, "--artefact: found nothing"),
        ({"kind": "tip", "targets": "S1"}, "--targets"),
    ],
)
def test_wishes_that_cannot_be_met_are_told(tmp_path: Path, changes: Any, said: str) -> None:
    async def story(page: Page) -> None:
        with pytest.raises(BadInput, match=said):
            await page.do("begin", SEATS | changes)
        assert page.told()["phase"] == "none"
        await page.do("begin", SEATS)  # nothing stands in the way of the next

    on_page(tmp_path, story)


def test_what_is_no_deed_is_refused(tmp_path: Path) -> None:
    async def story(page: Page) -> None:
        with pytest.raises(ArmdError, match="no guided measurement"):
            await page.do("finish")
        page.feed.arm = None
        with pytest.raises(ArmdError, match="daemon is not there"):
            await page.do("begin", SEATS)
        page.feed.arm = Daemon(page.arm)
        await page.do("begin", SEATS)
        with pytest.raises(NotServed):
            await page.do("format-disk")
        with pytest.raises(BadInput, match="no reading"):
            await page.do("finish")
        for body in (b"[]", b"{"):
            with pytest.raises(NotServed):
                await page.guided.do(Request("POST", "/guided/begin", {}, {}, body))

    on_page(tmp_path, story)


def test_a_full_disk_is_told_and_ends_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def story(page: Page) -> None:
        await page.do("begin", SEATS)

        def full(*_: Any) -> None:
            raise OSError(28, "No space left on device")

        with monkeypatch.context() as patch:
            patch.setattr("armd.daemon.measure.log.Log.append", full)
            await page.presses(1)
            assert page.told()["outcome"]["event"] == "failed"
            assert "No space left" in page.told()["outcome"]["text"]
        await page.presses(2)
        assert page.told()["state"]["taken"] == 1

    on_page(tmp_path, story)
