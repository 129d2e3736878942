"""The dialogues of the standard, every error the server gives, coordinate systems and tools."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from dme_bench import MEASUREMENT, Bench
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from armd import Flag
from armd.daemon.bridges.ippdme.commands_2_5 import VERSIONS
from armd.daemon.bridges.ippdme.csy import Transformation, locate_state_file
from armd.daemon.bridges.ippdme.errors import DmeError
from armd.daemon.bridges.tips import CmmTip
from support.pages import page_path

PAGE = page_path("ippdme")


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    bench = Bench(tmp_path)
    assert bench.type("00001 StartSession()") == ["00001 &", "00001 %"]
    return bench


def test_the_dialogue_of_the_standard(bench: Bench) -> None:
    assert bench.type("00002 GetDMEVersion()")[1] == '00002 # DMEVersion("1.4.3")'
    assert bench.type("00003 OnPtMeasReport(X(),Y(),Z(),IJK(),ER())") == ["00003 &", "00003 %"]
    assert bench.press() == []  # the user is not enabled
    bench.type("00004 EnableUser()")
    assert bench.press() == [
        "E0000 # PtMeas(X(1.50000), Y(2.50000), Z(3.50000), "
        "IJK(0.000000, 0.000000, 1.000000), ER(1.50000))"
    ]
    before = len(bench.said)
    for key in ("Del", "Done", "F1"):
        bench.session.take_key(key, 1)
    assert bench.said[before:] == [f'E0000 # KeyPress("{key}")' for key in ("Del", "Done", "F1")]
    assert bench.type("E0553 OnMoveReportE(Time(1),Dis(20),X(),Y(),Z())") == ["E0553 &", "E0553 %"]
    bench.move(50.0, 433.0, 500.0)
    bench.session.tick(bench.now_s)
    assert bench.said[-1] == "E0553 # X(50.00000), Y(433.00000), Z(500.00000)"
    assert bench.type("00005 StopDaemon(E0553)") == ["00005 &", "00005 %"]
    bench.session.tick(bench.now_s + 10)
    assert bench.said[-1] == "00005 %"
    assert bench.type("00006 GoTo(X(100))") == [
        "00006 &",
        '00006 ! Error(3, 0501, "GoTo", "Unsupported command")',
        "00006 %",
    ]
    assert bench.type("00007 Get(X())") == [
        "00007 &",
        '00007 ! Error(2, 0514, "Get", "Use ClearAllErrors to continue")',
        "00007 %",
    ]
    assert bench.type("E0001 GetErrStatusE()")[1] == "E0001 # ErrStatus(1)"
    assert bench.type("00011 GetXtdErrStatus()") == [
        "00011 &",
        "00011 # IsHomed(1)",
        "00011 # IsUserEnabled(1)",
        '00011 ! Error(3, 0501, "GoTo", "Unsupported command")',
        "00011 %",
    ]
    assert bench.type("00008 ClearAllErrors()", "00012 Get(X(),Y())")[-2:] == [
        "00012 # X(50.00000), Y(433.00000)",
        "00012 %",
    ]
    assert bench.type("00009 EndSession()") == ["00009 &", "00009 %"]
    assert bench.error("00010 Get(X())") == (3, 507)


def test_the_page_shows_this_dialogue(bench: Bench) -> None:
    shown = re.findall(r"^(C|S) (.*)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(shown) > 8
    bench.type("00099 EndSession()")
    for who, line in shown:
        if line.startswith("E0000"):
            bench.press()
            assert bench.said[-1] == line
        elif who == "C":
            answer = bench.type(line)
        else:
            assert answer.pop(0) == line


def test_a_press_has_what_was_asked_for_in_that_order(bench: Bench) -> None:
    bench.type("00002 OnPtMeasReport(Q(), Z(), X())", "00003 EnableUser()")
    flags = int(Flag.TEMPERATURE_RANGE | Flag.AT_REST)
    assert bench.press(flags=flags) == ["E0000 # PtMeas(Q(50), Z(3.50000), X(1.50000))"]
    assert bench.press(position_mm=None) == []
    bench.type("00004 OnPtMeasReport(IJK())")
    assert bench.press(approach=None) == ["E0000 # PtMeas(IJK(0.000000, 0.000000, -1.000000))"]
    bench.type("00005 EndSession()", "00006 StartSession()", "00007 EnableUser()")
    assert bench.press() == ["E0000 # PtMeas(X(1.50000), Y(2.50000), Z(3.50000))"]


def test_a_key_is_no_hit(bench: Bench) -> None:
    bench.type("00002 EnableUser()")
    bench.session.take_key("Done", 7)
    assert bench.press(seq=7) == []
    assert len(bench.press(seq=8)) == 1


def test_motion_is_reported_by_time_or_distance_ten_times_a_second_at_most(bench: Bench) -> None:
    bench.type("E0001 OnMoveReportE(Dis(1), X())")
    told = []
    for i in range(200):
        bench.now_s = 100 + i / 50
        bench.move(0.4 * i, 0, 0)
        before = len(bench.said)
        bench.session.tick(bench.now_s)
        told += [i / 50] * (len(bench.said) - before)
    assert (np.diff(told) >= 0.1 - 1e-9).all()
    assert len(told) == pytest.approx(34, abs=8)  # every third or fifth of 200
    assert bench.type("00002 StopAllDaemons()") == ["00002 &", "00002 %"]
    bench.type("E0002 OnMoveReportE(Time(0.5), X())")
    before = len(bench.said)
    for _ in range(100):
        bench.now_s += 0.02
        bench.move(1, 1, 1)
        bench.session.tick(bench.now_s)
    assert len(bench.said) - before == 4
    bench.type("00003 SetCoordSystem(PartCsy)")
    before = len(bench.said)
    bench.now_s += 0.1
    bench.session.tick(bench.now_s)
    assert bench.said[before:] == ["E0002 # X(1.00000)"]


# --- errors ------------------------------------------------------------------------------------


def test_errors_of_the_arm(bench: Bench) -> None:
    assert not bench.machine.take_loss()
    bench.move(0, 0, 0, flags=int(Flag.INVALID))
    assert bench.error("00002 Get(X())") == (3, 1000)
    bench.now_s += 2.0
    assert bench.machine.take_loss()
    assert not bench.machine.take_loss()
    assert bench.error("00003 Get(X())") == (9, 503)
    assert bench.error("00004 Home()") == (3, 1005)
    bench.session.take_error(DmeError(2503), "encoder3")
    assert bench.said[-1] == 'E0000 ! Error(9, 2503, "encoder3", "Scale read head failure")'
    assert bench.error("00005 IsHomed()") == (2, 514)


def test_no_tool_cannot_measure(bench: Bench) -> None:
    bench.type('00002 ChangeTool("NoTool")', "00003 EnableUser()")
    assert bench.press() == []
    assert bench.error("00004 PtMeas(X(0))") == (3, 507)
    assert bench.error("00005 GetProp(Tool.PtMeasPar.Accel())") == (3, 507)
    assert bench.error("00006 EnumProp(Tool.PtMeasPar())") == (3, 507)
    assert bench.type("00007 GetProp(Tool.Name())")[1] == '00007 # Tool.Name("NoTool")'


def test_one_session_at_a_time(bench: Bench) -> None:
    said: list[str] = []
    other = bench.client(said)
    other.receive("00001 StartSession()")
    assert said == [
        "00001 &",
        '00001 ! Error(3, 0008, "StartSession", "Protocol error")',
        "00001 %",
    ]
    other.receive("00002 Get(X())")
    assert said[-2].startswith("00002 ! Error(3, 0507,")
    bench.type("00002 EnableUser()")
    other.take_measurement(MEASUREMENT)
    assert len(said) == 6
    other.end()  # a stranger's end ends nothing
    assert len(bench.press()) == 1
    bench.session.end()  # vanished
    other.receive("00003 StartSession()")
    assert said[-2:] == ["00003 &", "00003 %"]


def test_a_nominal_point_waits_for_the_operator(bench: Bench) -> None:
    assert bench.type("00002 PtMeas(X(1), Y(2), Z(3), IJK(0,0,1))") == ["00002 &"]
    assert bench.type("E0003 GetErrStatusE()")[-1] == "E0003 %"  # out of turn
    assert bench.type("00004 IsHomed()") == ["00004 &"]
    assert bench.press() == [
        "00002 # X(1.50000), Y(2.50000), Z(3.50000)",
        "00002 %",
        "00004 # IsHomed(1)",
        "00004 %",
    ]
    bench.type("00005 PtMeas(X(500))")
    assert bench.press()[0] == '00005 ! Error(2, 1006, "PtMeas", "Surface not found")'


def test_abort(bench: Bench) -> None:
    bench.type("E0001 OnMoveReportE(Dis(3), X())", "00002 PtMeas(X(1))", "00003 IsHomed()")
    aborted = "Transaction aborted (Use ClearAllErrors To Continue)"
    assert bench.type("E0004 AbortE()") == [
        "E0004 &",
        f'00002 ! Error(2, 0006, "PtMeas", "{aborted}")',
        "00002 %",
        f'00003 ! Error(2, 0006, "IsHomed", "{aborted}")',
        "00003 %",
        "E0004 %",
    ]
    assert bench.press() == []
    assert bench.error("00005 IsHomed()") == (2, 514)
    bench.move(9, 9, 9)
    bench.session.tick(200.0)
    assert bench.said[-1] == "E0001 # X(9.00000)"  # daemons live on


def test_an_error_aborts_what_waits_behind_it(bench: Bench) -> None:
    bench.type("00002 PtMeas(X(500))", "00003 IsHomed()", "00004 IsHomed()")
    numbers = [re.search(r", (\d{4}),", line) for line in bench.press()]
    assert [match[1] for match in numbers if match] == ["1006", "0006", "0006"]


# --- tools -------------------------------------------------------------------------------------


def test_tools(bench: Bench) -> None:
    assert bench.type("00002 EnumTools()")[1:-1] == [
        f'00002 # "{name}"' for name in ("RefTool", "NoTool", "Ball3", "long", "PROBE1.TIP1A0B0")
    ]
    assert bench.type('00003 FindTool("long")', "00004 GetProp(FoundTool.AvrRadius())")[-2] == (
        "00004 # FoundTool.AvrRadius(3.00000)"
    )
    assert bench.type("00005 GetProp(Tool.Name(), Tool.AvrRadius(), Tool.Alignment())")[1] == (
        '00005 # Tool.Name("Ball3"), Tool.AvrRadius(1.50000), '
        "Tool.Alignment(0.000000, 0.000000, -1.000000)"
    )
    bench.type("00006 SetProp(Tool.PtMeasPar.Speed(500))")
    assert bench.type("E0007 GetPropE(Tool.PtMeasPar.Speed(), Tool.PtMeasPar.Speed.Def())")[1] == (
        "E0007 # Tool.PtMeasPar.Speed(500.00000), Tool.PtMeasPar.Speed.Def(10.00000)"
    )
    bench.type("00008 SetProp(Tool.PtMeasPar.Speed(1e6))")
    assert "Speed(1000.00000)" in bench.type("00009 GetProp(Tool.PtMeasPar.Speed())")[1]
    assert bench.type("00010 EnumProp(Tool.GoToPar())")[1:-1] == [
        '00010 # "Speed", "Number"',
        '00010 # "Accel", "Number"',
    ]
    assert '00011 # "PtMeasPar.Speed.Max", "Number"' in bench.type("00011 EnumAllProp(Tool())")


def test_the_host_changes_the_tool(bench: Bench) -> None:
    assert bench.type('00002 ChangeTool("Ball3")') == ["00002 &", "00002 %"]  # it is on already
    assert bench.type('00003 ChangeTool("PROBE1.TIP1A0B0")') == ["00003 &"]
    assert bench.machine.toolbox.note_tip("long") is None  # the arm's own event: nothing new
    ((name, settle),) = bench.asked
    assert name == "long"
    settle(True)
    assert bench.said[-1] == "00003 %"
    assert bench.type("00004 GetProp(Tool.Name())")[1] == '00004 # Tool.Name("PROBE1.TIP1A0B0")'
    bench.type('00005 ChangeTool("RefTool")')
    bench.asked[-1][1](False)
    assert bench.said[-2] == '00005 ! Error(3, 0511, "ChangeTool", "Error processing method")'
    bench.type("00006 ClearAllErrors()")
    assert bench.type("00007 GetProp(Tool.Name())")[1] == '00007 # Tool.Name("PROBE1.TIP1A0B0")'


def test_the_operator_changes_the_tool(bench: Bench) -> None:
    assert bench.machine.toolbox.note_tip("Ball3") is None
    for tip, name in ((None, "RefTool"), ("long", "PROBE1.TIP1A0B0"), ("Ball3", "Ball3")):
        tool = bench.machine.toolbox.note_tip(tip)
        assert tool is not None
        bench.session.take_tool(tool.name)
        assert bench.said[-1] == f'E0000 # ChangeTool("{name}")'


def test_a_tip_calibrated_anew_is_the_tool_as_it_is_now(bench: Bench) -> None:
    bench.machine.toolbox.renew("Ball3", CmmTip((0.0, 0.0, 91.0), 1.25))
    bench.machine.toolbox.renew("glass", CmmTip((0.0, 0.0, 50.0), 0.5))
    tool = bench.machine.toolbox.get("Ball3")
    assert tool.radius_mm == 1.25
    assert bench.machine.toolbox.get("glass").radius_mm == 0.5
    assert "glass" in bench.machine.toolbox.names
    # What was pressed with the one of before keeps its radius.
    bench.type("00002 OnPtMeasReport(ER())", "00003 EnableUser()")
    then = {"tip_offset_mm": [0.0, 0.0, 90.0], "tip_radius_mm": 1.5}
    assert bench.press(**then) == ["E0000 # PtMeas(ER(1.50000))"]


# --- coordinate systems ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("angles", "expected"),
    [
        ((0, 0, 90), (30, -90, -5)),
        ((90, 0, 0), (90, -5, -30)),
        ((30, 45, 20), (66.313890, -65.897115, 16.883076)),
    ],
)
def test_the_vectors_of_the_standard(
    bench: Bench, angles: tuple[float, ...], expected: tuple[float, ...]
) -> None:
    theta, psi, phi = angles
    bench.type(
        f"00002 SetCsyTransformation(PartCsy, 10, 20, 30, {theta}, {psi}, {phi})",
        "00003 SetCoordSystem(PartCsy)",
    )
    bench.move(100, 50, 25)
    told = bench.type("00004 Get(X(),Y(),Z())")[1]
    assert [float(x) for x in re.findall(r"\(([^)]+)\)", told)] == pytest.approx(expected, abs=2e-5)


@given(st.tuples(st.floats(0, 180), st.floats(-720, 720), st.floats(-720, 720)))
@settings(deadline=None)
def test_rotations_are_scipys(angles: tuple[float, float, float]) -> None:
    theta, psi, phi = angles
    ours = Transformation(0, 0, 0, theta, psi, phi).rotation()
    back = Rotation.from_euler("zxz", (phi, theta, psi), degrees=True).as_matrix()
    assert ours == pytest.approx(back.T, abs=1e-12)


def test_systems_stand_on_each_other_and_outlive_the_process(bench: Bench, tmp_path: Path) -> None:
    bench.type(
        "00002 SetCsyTransformation(MultipleArmCsy, 1, 0, 0, 0, 0, 0)",
        "00003 SetCsyTransformation(MoveableMachineCsy, 0, 10, 0, 0, 0, 90)",
        "00004 SetCsyTransformation(PartCsy, 0, 0, 100, 0, 0, 0)",
        "00005 SetCoordSystem(MoveableMachineCsy)",
    )
    bench.move(1, 11, 5)
    assert bench.type("00006 Get(X(),Y(),Z())")[1] == "00006 # X(1.00000), Y(0.00000), Z(5.00000)"
    bench.type("00007 SetCoordSystem(PartCsy)", "00008 EnableUser()", "00009 OnPtMeasReport(IJK())")
    assert bench.press(approach=[-1.0, 0, 0]) == [
        "E0000 # PtMeas(IJK(0.000000, -1.000000, 0.000000))"
    ]
    later = Bench(tmp_path)
    later.move(1, 11, 5)
    later.type("00001 StartSession()")
    assert later.type("00002 GetCoordSystem()")[1] == "00002 # CoordSystem(PartCsy)"
    assert later.type("00003 Get(Z())")[1] == "00003 # Z(-95.00000)"
    assert later.type("00004 GetCsyTransformation(PartCsy)")[1] == (
        "00004 # GetCsyTransformation(0.000000, 0.000000, 100.000000, 0.000000, 0.000000, 0.000000)"
    )


@pytest.mark.parametrize(
    "content", ['{"schema": "armd.ippdme/1", "selected": "BleepCsy"}', "{", "", '{"x0": Infinity}']
)
def test_a_damaged_state_is_set_aside_and_the_host_must_clear_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: str
) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    path = locate_state_file("S")
    assert path == tmp_path / "ippdme-S.json"
    bench = Bench(tmp_path)
    path = tmp_path / "state" / "ippdme-S.json"
    path.parent.mkdir(exist_ok=True)
    path.write_text(content)
    bench = Bench(tmp_path)
    assert "ippdme-S.json" in (bench.machine.systems.lost or "")
    assert not path.exists()
    assert path.with_name("ippdme-S.json.damaged").read_text() == content
    lines = bench.type("00001 StartSession()")
    assert 'E0000 ! Error(3, 1013, "StartSession", "Coordinate system not found")' in lines
    assert "0514" in bench.type("00002 Get(X())")[1]  # nothing is measured before it is cleared
    bench.type("00003 ClearAllErrors()")
    assert bench.type("00004 Get(X())")[1] == "00004 # X(99.93000)"
    bench.type("00005 EndSession()")
    assert bench.type("00006 StartSession()") == ["00006 &", "00006 %"]  # said once


@pytest.mark.parametrize("number", ["1E999", "-1E999", "1e400", "1E308", "-2e6"])
def test_no_origin_beyond_a_machine_is_taken_or_kept(tmp_path: Path, number: str) -> None:
    bench = Bench(tmp_path)
    bench.type("00001 StartSession()")
    answer = bench.type(f"00002 SetCsyTransformation(PartCsy, {number}, 0, 0, 0, 0, 0)")
    assert "! Error(3, 05" in answer[1]
    bench.type("00003 ClearAllErrors()", "00004 SetCoordSystem(PartCsy)")
    assert bench.type("00005 Get(X())")[1] == "00005 # X(99.93000)"
    later = Bench(tmp_path)
    later.type("00001 StartSession()")
    assert later.type("00002 Get(X())")[1] == "00002 # X(99.93000)"


def test_a_direction_is_the_tools_in_use_in_1_4_3(bench: Bench) -> None:
    """NIST's parser refuses `FoundTool.Alignment`."""
    bench.type('00002 FindTool("long")')
    assert "0510" in bench.type("00003 GetProp(FoundTool.Alignment())")[1]


# --- 2.5 ---------------------------------------------------------------------------------------


@pytest.fixture
def new(tmp_path: Path) -> Bench:
    bench = Bench(tmp_path, "2.5")
    bench.type("00001 StartSession()")
    return bench


def test_2_5_says_the_same_otherwise(new: Bench) -> None:
    new.machine.temperatures_c = {"joint3": 21.3, "t2": None}
    dialogue = {
        "GetDMEVersion()": ['DMEVersion("2.5")'],
        "GetMachineClass()": ['"CartCMM_TouchTrigger_Fixed_None_ToolChanger_None_None"'],
        "GetCoordSystem()": ["MachineCsy"],
        "GetErrStatusE()": ["0"],
        "EnumTools()": ["RefTool", "NoTool", "Ball3", "long", '"PROBE1.TIP1A0B0"'],
        "GetTemperatureSensors()": [
            'Name("joint3"), Kind(CMM), CMMTempCorrection(1)',
            'Name("t2"), Kind(CMM), CMMTempCorrection(1)',
        ],
        'ReadTemperatureSensor("joint3")': ["21.30"],
        "ReadAllTemperatures()": [
            'Name("joint3"), Temperature(21.30)',
            'Name("t2"), Temperature(-273.00)',
        ],
    }
    for command, expected in dialogue.items():
        assert new.type(f"00002 {command}") == [
            "00002 &", *(f"00002 # {line}" for line in expected), "00002 %",
        ]  # fmt: skip
    told = new.type("00003 GetCsyTransformation(PartCsy)")[1]
    assert told.startswith("00003 # X0(0.000000), Y0(0.000000), ")
    assert new.error("00004 OnMoveReport(Time(1), Dis(1), X())") == (3, 502)
    assert new.type("E0005 OnMoveReport(Time(1), Dis(1), X())") == ["E0005 &", "E0005 %"]
    assert new.error("E0006 OnMoveReportE(Time(1), X())") == (3, 502)
    new.type("00007 GoTo(X(1))")
    assert new.type("00008 GetXtdErrStatus()")[1:-1] == [
        "00008 # IsHomed(1)",
        "00008 # IsUserEnabled(0)",
        "00008 # ActiveError(0501), Severity(3)",
    ]


def test_2_5_keeps_named_systems(new: Bench) -> None:
    new.type(
        "00002 SetCsyTransformation(PartCsy, 1, 2, 3, 0, 0, 0)",
        '00003 SaveActiveCoordSystem("fixture 1")',
        '00004 SaveNamedCsyTransformation("other", 0, 0, 7, 0, 0, 0)',
        '00005 LoadCoordSystem("other")',
    )
    assert new.type("00006 EnumCoordSystems()")[1:-1] == ['00006 # "fixture 1"', '00006 # "other"']
    assert new.type("00007 Get(Z())")[1] == "00007 # Z(-12.00000)"
    assert "Z0(3.000000)" in new.type('00008 GetNamedCsyTransformation("fixture 1")')[1]
    new.type('00009 DeleteCoordSystem("other")')
    assert new.error('00010 LoadCoordSystem("other")') == (3, 1013)


def test_1_4_3_has_none_of_it(bench: Bench) -> None:
    for name in set(VERSIONS["2.5"]) - set(VERSIONS["1.4.3"]):
        assert bench.error(f"00002 {name}()") == (3, 501)


# --- anything ----------------------------------------------------------------------------------

LINES = st.one_of(
    st.text(st.characters(max_codepoint=255), max_size=40),
    st.builds(
        "{:05d} {}({})".format,
        st.integers(0, 20),
        st.sampled_from([*VERSIONS["2.5"], "Bleep"]),
        st.sampled_from(["", "X()", "Time(1), X()", '"Ball3"', "1,2,3,4,5,6", "PartCsy", "E0001"]),
    ),
)


@given(st.lists(LINES, max_size=30))
@settings(deadline=None, max_examples=60)
def test_whatever_is_typed_the_answer_is_of_the_standard(
    tmp_path_factory: pytest.TempPathFactory, lines: list[str]
) -> None:
    """`Bench.client` checks each line that is said; each tag is acknowledged and completed."""
    bench = Bench(tmp_path_factory.mktemp("any"), "2.5")
    bench.type("00001 StartSession()", *lines)
    bench.type("E9998 AbortE()")
    acknowledged = Counter(line[:5] for line in bench.said if line.endswith(" &"))
    assert acknowledged == Counter(line[:5] for line in bench.said if line.endswith(" %"))
