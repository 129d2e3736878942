"""Every row of the standard's error table: provoked, letter for letter, or why it never is."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from dme_bench import Bench

from armd import Flag
from armd.daemon.bridges.ippdme import server
from armd.daemon.bridges.ippdme.commands_2_5 import ARGUMENTS
from armd.daemon.bridges.ippdme.dialogue import MOST_WAITING
from armd.daemon.bridges.ippdme.errors import BLOCKING, TABLE, DmeError

#: Severity, number, text: copied from the standard (1.4.3, 8.2; those of 2.5 after it).
ROWS = """
0 0000 Buffer full
2 0001 Illegal tag
2 0002 No space at pos. 6
2 0006 Transaction aborted (Use ClearAllErrors To Continue)
3 0007 Illegal character
3 0008 Protocol error
3 0500 Emergency stop
3 0501 Unsupported command
3 0502 Incorrect arguments
9 0503 Controller communications failure
1 0504 Argument out of range
3 0505 Argument not recognized
3 0506 Argument not supported
3 0507 Illegal command
3 0508 Bad context
3 0509 Bad argument
3 0510 Bad property
3 0511 Error processing method
1 0512 No daemons are active
2 0513 Daemon does not exist
2 0514 Use ClearAllErrors to continue
2 0515 Daemon already exists
3 1000 Machine in error state
2 1001 Illegal touch
9 1002 Axis does not exist
2 1003 No touch
9 1004 Number of angles not supported on current device
3 1005 Error during home
2 1006 Surface not found
3 1007 Theta out of range
3 1008 Target position out of machine volume
3 1009 Air pressure out of range
2 1010 Vector has no norm
2 1011 Unable to move
2 1012 Bad lock combinations
3 1013 Coordinate system not found
2 1014 Failed to set value due to active internal correction
3 1500 Failed to re-seat head
3 1501 Probe not armed
3 1502 Tool not found
3 1503 Tool not defined
3 1504 Collection not found
2 1505 Tool not alignable
1 1506 Tool property not applicable
3 1507 Tool not alignable to given orientation
3 2000 Tool not calibrated
2 2001 Head error excessive force
3 2002 Type of probe does not allow this operation
3 2003 Raw data of Acquisition not available
3 2004 No shared memory space available
3 2005 File not found
3 2500 Machine limit encountered [Move Out Of Limits]
3 2501 Axis not active
3 2502 Axis position error
9 2503 Scale read head failure
3 2504 Collision
2 2505 Specified angle out of range
2 2506 Part not aligned
2 5000 Wrong data format
2 5001 Port not available
"""
STANDARD = {
    int(number): (int(severity), text)
    for severity, number, text in (row.split(" ", 2) for row in ROWS.strip().splitlines())
}


def typed(line: str) -> Callable[[Bench], list[str]]:
    return lambda bench: bench.type(line)


def full_buffer(bench: Bench) -> list[str]:
    waiting = bench.type("00002 PtMeas(X(1))", *["00003 IsHomed()"] * (MOST_WAITING - 1))
    assert waiting == ["00002 &", *["00003 &"] * (MOST_WAITING - 1)]
    said = bench.type("00004 IsHomed()")
    assert (said[0], said[-1]) == ("00004 &", "00004 %")
    assert len(bench.press()) == 2 + 2 * (MOST_WAITING - 1)
    return said


def aborted(bench: Bench) -> list[str]:
    bench.type("00002 PtMeas(X(1))")
    return bench.type("E0003 AbortE()")


def silent(bench: Bench) -> list[str]:
    bench.now_s += 2.0
    return bench.type("00002 Get(X())")


def not_homed(bench: Bench) -> list[str]:
    bench.move(0, 0, 0, flags=int(Flag.INVALID))
    assert bench.type("00002 IsHomed()")[1] == "00002 # IsHomed(0)"
    return bench.type("00003 Home()")


def invalid(bench: Bench) -> list[str]:
    bench.move(0, 0, 0, flags=int(Flag.INVALID))
    return bench.type("00002 Get(X())")


def refused_by_the_daemon(bench: Bench) -> list[str]:
    bench.type('00002 ChangeTool("long")')
    before = len(bench.said)
    bench.asked[-1][1](False)
    return bench.said[before:]


def blocked(bench: Bench) -> list[str]:
    bench.type("00002 Bleep()")
    return bench.type("00003 IsHomed()")


def second_daemon(bench: Bench) -> list[str]:
    bench.type("E0001 OnMoveReportE(Dis(3), X())")
    return bench.type("E0002 OnMoveReportE(Dis(3), X())")


def missed(bench: Bench) -> list[str]:
    bench.type("00002 PtMeas(X(500))")
    return bench.press()


def told_by_the_arm(kind: str) -> Callable[[Bench], list[str]]:
    def press(bench: Bench) -> list[str]:
        number, place = server.FAULTS[kind]
        before = len(bench.said)
        bench.session.take_error(DmeError(number), place({"detail": {"joint": 3}}))
        assert '"encoder3"' in bench.said[-1]
        return bench.said[before:]

    return press


PROVOKED: dict[int, list[Callable[[Bench], list[str]]]] = {
    0: [full_buffer],
    1: [typed("ABCDE Get(X())"), typed("00000 Get(X())"), typed("E0007 Get(X())")],
    2: [typed("00002Get(X())")],
    6: [aborted],
    7: [typed("00002 Get(\x07)")],
    8: [typed("00002 StartSession()"), typed("00002 !")],
    501: [
        typed("00002 GoTo(X(1))"), typed("00002 Bleep()"), typed("00002 get(X())"),
        typed("00002 ScanOnLine(1,2,3)"), typed("00002 AlignTool(0,0,1,30)"),
        typed("00002 LockAxis(X())"), typed("00002 ReQualify()"),
    ],
    502: [
        typed("00002 Get()"), typed("00002 Home(1)"), typed("00002 OnPtMeasReport()"),
        typed("00002 OnMoveReportE(Time(1), X())"),
    ],
    503: [silent],
    504: [typed("00002 GetErrorInfo(0013)"), typed("00002 SetProp(Tool.PtMeasPar.Speed(1e6))")],
    505: [typed("00002 SetCoordSystem(BleepCsy)")],
    506: [typed("00002 SetCoordSystem(SensorCsy)")],
    507: [
        lambda bench: bench.type("00002 EndSession()", "00003 Get(X())"),
        lambda bench: bench.type('00002 ChangeTool("NoTool")', "00003 PtMeas(X(0))"),
        lambda bench: bench.type('00002 ChangeTool("NoTool")', "00003 ReQualify()"),
    ],
    509: [typed("00002 ChangeTool(5)"), typed('00002 SetCoordSystem("PartCsy")')],
    510: [
        typed("00002 Get(IJK())"), typed("00002 Get(X(), X())"),
        typed("00002 OnPtMeasReport(X(), Bleep())"), typed("00002 GetProp(Tool.Bleep())"),
        typed("E0002 OnMoveReportE(Time(0.09), X())"), typed("E0002 OnMoveReportE(Dis(-3), X())"),
    ],
    511: [refused_by_the_daemon],
    512: [typed("00002 StopAllDaemons()")],
    513: [typed("00002 StopDaemon(E0553)")],
    514: [blocked],
    515: [second_daemon],
    1000: [invalid],
    1002: [typed("00002 Get(R())")],
    1005: [not_homed],
    1006: [missed],
    1007: [typed("00002 SetCsyTransformation(PartCsy, 0, 0, 0, 181, 0, 0)")],
    1008: [
        typed("00002 PtMeas(X(123456789))"),
        lambda bench: bench.type(
            "00002 SetCsyTransformation(PartCsy, 900, 0, 0, 0, 0, 90)",
            "00003 SetCoordSystem(PartCsy)",
            "00004 PtMeas(Y(-101))",  # turned by 90°: x = 900 + 101 of the base
        ),
    ],
    1010: [typed("00002 PtMeas(X(0), IJK(0,0,0))")],
    1502: [typed('00002 ChangeTool("Bleep")'), typed('00002 FindTool("Bleep")')],
    1503: [typed('00002 ChangeTool("UnDefTool")'), typed('00002 GetChangeToolAction("UnDefTool")')],
    2502: [told_by_the_arm("count_jump")],
    2503: [told_by_the_arm("joint_invalid")],
}  # fmt: skip
PROVOKED_2_5: dict[int, list[Callable[[Bench], list[str]]]] = {
    506: [typed('00002 GetSupportedArguments("ReQualify")')],
    1013: [typed('00002 LoadCoordSystem("Bleep")')],
    1504: [
        typed('00002 EnumToolCollection("Bleep")'), typed('00002 OpenToolCollection("Tools/Ball3")')
    ],
}  # fmt: skip
#: Why this server never says it.
NEVER = {
    500: "no emergency stop: nothing is driven",
    508: "no command of a manual arm is right in one context and wrong in another",
    1001: "a press while moving is a hit with its scatter; a sample that is invalid gives none",
    1003: "PtMeas waits for the operator until AbortE: a person is no search that ends",
    1004: "no head with angles",
    1009: "no air bearings",
    1011: "what would move is unsupported before it is unable: 0501",
    1012: "LockAxis is 0501: a person cannot be locked",
    1014: "no setting of the host's touches the correction",
    1500: "no head",
    1501: "a tip without a switch needs no arming",
    1505: "AlignTool is 0501; IsAlignable(0) says so beforehand",
    1506: "a property that does not apply is 0507 with NoTool, else every tool has all",
    1507: "AlignTool is 0501",
    2000: "every tip has an offset of its own; what is not calibrated is the arm, and Q() says so",
    2001: "no force is measured",
    2002: "each tip touches; scanning is 0501 whatever the tip",
    2003: "no optical acquisitions",
    2004: "no shared memory",
    2005: "no files are asked for by name",
    2500: "end stops are the person's to feel; Q() of a hit near one says so",
    2501: "an encoder that is not referenced is 1005 and IsHomed(0)",
    2504: "nothing is driven",
    2505: "no angle but Theta can be specified, and that is 1007",
    2506: "AlignPart is 0501",
    5000: "no data are sent in a format of the host's",
    5001: "no second port",
}


def test_each_row_is_provoked_or_never() -> None:
    provoked = set(PROVOKED) | set(PROVOKED_2_5)
    assert provoked | set(NEVER) == set(STANDARD)
    assert not provoked & set(NEVER)


def test_the_table_is_the_standards_letter_for_letter() -> None:
    assert TABLE == STANDARD


@pytest.mark.parametrize(
    ("version", "number", "provoke"),
    [
        (version, number, provoke)
        for version, rows in (("1.4.3", PROVOKED), ("2.5", PROVOKED_2_5))
        for number, ways in rows.items()
        for provoke in ways
    ],
)
def test_rows(
    tmp_path: Path, version: str, number: int, provoke: Callable[[Bench], list[str]]
) -> None:
    bench = Bench(tmp_path, version)
    bench.type("00001 StartSession()")
    severity, text = STANDARD[number]
    told = [line for line in provoke(bench) if re.match(r"\S+ ! ", line)]
    assert len(told) == 1
    form = rf'(\d{{5}}|E\d{{4}}) ! Error\({severity}, {number:04d}, "[^"]+", "{re.escape(text)}"\)'
    assert re.fullmatch(form, told[0])
    if number == 0 or not bench.session.in_session:
        return
    bench.move(1, 1, 1)
    asked = bench.type("09000 IsUserEnabled()")
    assert ("0514" in asked[1]) == (severity >= BLOCKING)
    bench.type("09001 ClearAllErrors()")
    assert bench.type("09002 IsHomed()") == ["09002 &", "09002 # IsHomed(1)", "09002 %"]


def test_what_the_server_cannot_raise_stands_nowhere_in_it() -> None:
    """Or its reason would be none."""
    folder = Path(server.__file__).parent
    source = "".join(p.read_text(encoding="utf-8") for p in folder.glob("*.py"))
    raised = {int(n) for n in re.findall(r"DmeError\((?:510 if [^)]*else )?(\d+)", source)}
    raised |= {number for number, _ in server.FAULTS.values()}
    raised |= {int(n) for n in re.findall(r"SyntaxFault\((\d+)", source)}
    assert not raised & set(NEVER)
    assert raised <= set(PROVOKED) | set(PROVOKED_2_5)


# --- tools as the host may ask for them -------------------------------------------------------


def test_2_5_has_a_collection_of_all_tools(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "2.5")
    bench.type("00001 StartSession()")
    names = ["RefTool", "NoTool", "Ball3", "long", "PROBE1.TIP1A0B0"]
    dialogue = {
        'EnumToolCollection("/")': ['"Tools", "Collection"'],
        'EnumToolCollection("Tools")': [f'"{name}", "Tool"' for name in names],
        'EnumAllToolCollections("/")': [
            '"Tools", "Collection"', *(f'"Tools/{name}", "Tool"' for name in names)
        ],
        'OpenToolCollection("Tools")': [],
        'FindTool("long")': [],
        "FoundTool()": ["long"],
        "Tool()": ["Ball3"],
        "GetProp(Tool.Collection())": ['Tool.Collection("Tools")'],
        "IsAlignable()": ["IsAlignable(0)"],
        "EnumNameSpaces()": [],
        "EnumerateMoverAxes()": ["X(), Y(), Z()"],
        'GetSupportedArguments("SetCsyTransformation")': [
            '"CoordSystem", "name"',
            *(f'"{name}", "float"' for name in ("X0", "Y0", "Z0", "Theta", "Psi", "Phi")),
        ],
        'GetSupportedArguments("IsHomed")': [],
    }  # fmt: skip
    for command, expected in dialogue.items():
        assert bench.type(f"00002 {command}") == [
            "00002 &", *(f"00002 # {line}" for line in expected), "00002 %",
        ]  # fmt: skip


def test_what_is_said_to_be_supported_is(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "2.5")
    bench.type("00001 StartSession()")
    names = [line[9:-1] for line in bench.type("00002 GetSupportedCommands()")[1:-1]]
    assert "ReQualify" not in names
    assert set(ARGUMENTS) <= set(names)
    for name in set(names) - {"StartSession", "EndSession", "AbortE"}:
        tag = "E0003" if name.endswith("E") or name == "OnMoveReport" else "00003"
        told = bench.type(f"{tag} {name}()")
        assert not any("0501" in line for line in told), name
        bench.type("00004 ClearAllErrors()")
        # Who has arguments does not take none, and the other way round.
        wants = any("0502" in line for line in told)
        optional = name in ("OnMoveReport", "OnMoveReportE")
        assert wants == (name in ARGUMENTS) or optional, name
