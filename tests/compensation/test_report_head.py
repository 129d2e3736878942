"""The form of a report that is signed: its head, its foot, and what stands before the appendix."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from armd.compensation.data.sessions.format import Artefact
from armd.compensation.data.sessions.session import Session
from armd.compensation.model.arm import Arm
from armd.compensation.report.layout.about import About, load_about
from armd.compensation.report.layout.head import add_head
from armd.compensation.report.layout.page import MOST_LETTERS, Page
from armd.compensation.report.layout.style import make_footer_style
from armd.compensation.report.layout.units import Unit, choose_units, format_three_digits
from armd.compensation.report.sessions import add_session_facts
from armd.daemon.cli import main
from armd.errors import BadInput
from support.readings import session_of, states_of

ARM = {"schema": "armd.arm/1", "serial_number": "A-1"}


def an_arm(counts: int | None, a_mm: float = 300.0) -> Arm:
    joint = {"a_mm": a_mm, "counts_per_turn": counts}
    return Arm.model_validate(ARM | {"joint": [joint] * 3, "temperature_sensor": [{"name": "t1"}]})


def a_session(started: float, **artefact: object) -> Session:
    states = states_of(np.zeros((2, 3)), temperature_c=np.array([[20.0], [21.26]]))
    beam = Artefact.model_validate({"name": "beam", "target": [{"name": "B"}]} | artefact)
    return session_of("s", "A-1", beam, states, started_unix_s=started)


def head_of(arm: Arm | None, *sessions: Session, about: About | None = None) -> dict[str, str]:
    page = Page("P")
    add_head(page, arm, sessions, about)
    text = page.to_html()
    shown = dict(re.findall(r"<dt>(.*?)</dt><dd[^>]*>(.*?)</dd>", text))
    assert text.count('<dd class="blank"></dd>') == list(shown.values()).count("")
    return shown


def test_the_head_says_what_the_files_say() -> None:
    certified = {"certificate": "C-7", "certificate_valid_until": "2027-03-01"}
    sessions = [a_session(started, **certified) for started in (1.7725e9, 1.7727e9)]
    shown = head_of(an_arm(None), *sessions, about=About(document="K<1>", operator="Li"))
    assert shown["document"] == "K&lt;1&gt;" and shown["operator"] == "Li"
    assert shown["arm, serial number"] == "A-1"
    assert shown["measured on"] == "2026-03-03 to 2026-03-05"
    assert shown["artefact"] == "beam"
    assert shown["certificate"] == "C-7, valid until 2027-03-01"
    assert shown["environment"] == "arm 20.0 to 21.3 °C"
    assert shown["software"].startswith("armd ")
    assert {name for name, value in shown.items() if not value} == {
        "customer", "laboratory", "place",
    }  # fmt: skip


def test_what_nobody_knows_is_a_line_to_fill_in() -> None:
    shown = head_of(None)
    assert shown.pop("software") and set(shown.values()) == {""}


def test_an_arm_of_points_alone_has_no_number_and_a_table_no_day() -> None:
    unnamed = an_arm(None).model_copy(update={"serial_number": "-"})
    assert head_of(unnamed, a_session(0.0))["arm, serial number"] == ""
    page = Page("P")
    add_session_facts(page, [a_session(0.0)], unnamed)
    assert "1970" not in page.to_html()


def test_a_certificate_without_a_last_day_leaves_room_for_it() -> None:
    shown = head_of(an_arm(None), a_session(0.0, certificate="C-7"))
    assert shown["certificate"] == "C-7, valid until __________"
    assert shown["measured on"] == ""  # an instant of 0 is nobody's


@pytest.mark.parametrize("day", ["2027-02-30", "next year"])
def test_a_day_is_of_the_calendar(day: str) -> None:
    with pytest.raises(ValueError, match="a day as 2027-03-01"):
        a_session(0.0, certificate_valid_until=day)


def test_the_foot_has_the_serial_number_whatever_is_in_it() -> None:
    style = make_footer_style('A-1"; } </style>')
    assert 'counter(page) " of " counter(pages)' in style
    assert "</style>" not in style and style.count('"') == 6
    assert '"A\\00002d1\\000022' in style
    assert "A\\00002d1" in Page("Verification", "A-1").to_html()


def test_long_texts_are_short_before_the_appendix_and_whole_in_it() -> None:
    page = Page("P")
    long = "x" * 2 * MOST_LETTERS
    page.add_verdict("NO", page.abbreviate("Verdict", long), good=False, key="one")
    page.add_items_in_brief("Remarks", [f"remark {i}." for i in range(20)], limit=3)
    page.add_items_in_brief("Nothing", [])
    page.begin_appendix()
    page.add_heading("More")
    before, after = page.to_html().split('id="appendix">Appendix</h2>')
    assert "remark 2." in before and "remark 3." not in before and "17 more" in before
    assert long not in before and long in after and "remark 19." in after
    assert "<h3>More</h3>" in after and "Nothing" not in before
    assert '<p class="key">one</p>' in before


def test_units_are_those_that_the_arm_resolves() -> None:
    fine, coarse = choose_units(an_arm(1 << 24)), choose_units(an_arm(4096))
    assert (fine.length.name, fine.angle.name) == ("µm", "″")
    assert (coarse.length.name, coarse.angle.name) == ("mm", "°")
    assert (
        fine.length.format_value(0.01234, "+") == "+12.34"
        and coarse.length.format_value(0.5) == "0.50"
    )
    assert fine.length.format_value(float("nan")) == "–"
    assert fine.length.to_text(0.01234) == "12.3\N{NO-BREAK SPACE}µm"
    assert (
        fine.length.scale_to(0.5, 1.2) == Unit("mm", 1.0, 3)
        and fine.length.scale_to(0.5) == fine.length
    )
    assert [format_three_digits(x) for x in (0.0, 1234.5, 0.01234)] == ["0", "1234", "0.0123"]


COMMANDS = {
    "calibrate": ["calibrate", "none", "--arm", "none.toml", "-o", "new.json"],
    "verify": ["verify", "none", "--arm", "none.toml"],
    "diagnose": ["diagnose", "none", "--arm", "none.toml"],
    "interim": ["interim", "report", "--history", "none"],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_bad_file_is_told_before_the_work(
    command: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    about = Path("about.toml")
    about.write_text('document = "K-1"\nclient = "C"\n')
    asked = [*COMMANDS[command], "--about", "about.toml"]
    assert main([*asked, "--report", "r.html"]) == 2
    assert "about.toml: client" in capsys.readouterr().err
    about.write_text('document = "K-1"\n')
    assert main(asked) == 2
    assert "--report or --pdf" in capsys.readouterr().err
    assert main([*asked, "--report", "about.toml"]) == 2  # an input is never written over
    assert load_about(about).document == "K-1"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["about.toml"]


@pytest.mark.parametrize("text", ['document = ""', 'place = "' + "x" * 121 + '"', "operator = 3"])
def test_an_entry_is_a_line_of_text(text: str, tmp_path: Path) -> None:
    path = tmp_path / "about.toml"
    path.write_text(text)
    with pytest.raises(BadInput, match=text.split()[0]):
        load_about(path)
