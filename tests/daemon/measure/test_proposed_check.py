"""`armd measure interim --proposed`: the check that a history proposes, measured by one command."""

import json

import pytest
from test_measure_command import command  # noqa: F401  (a fixture)
from test_measuring import ARM, poses_table, press, reaching

from armd.daemon.measure.plan.kinds import make_plan
from armd.daemon.measure.plan.stations import Wishes
from armd.errors import BadInput

#: Two seats, touched in turn: S1 at the first, S2 at the second.
SEATS = [[400.0, 150.0, 60.0], [300.0, -220.0, 90.0]]
NEAR = [20.0, 30.0, -40.0], [-40.0, 35.0, -45.0]


@pytest.fixture
def history(tmp_path):
    """A history whose last result proposes four poses on two seats."""
    postures = [reaching(SEATS[i % 2], NEAR[i % 2]).tolist() for i in range(4)]
    proposed = {
        "sentence": "to tell one from the other: seats",
        "seats_mm": SEATS,
        "poses_deg": postures,
        "approach": ["+-+", "--+", "+++", "---"],
    }
    result = {"schema": "armd.interim/1", "arm": ARM.serial_number, "next_check": proposed}
    folder = tmp_path / "history"
    folder.mkdir()
    (folder / "report.json").write_text(json.dumps(result))
    return folder


def changed(history, **keys):
    """The result with other contents of `next_check`, or of the result itself."""
    path = history / "report.json"
    result = json.loads(path.read_text())
    (result if "arm" in keys or "schema" in keys else result["next_check"]).update(keys)
    path.write_text(json.dumps(result))


def test_its_poses_are_gone_to_in_turn(history):
    plan = make_plan("interim", ARM, None, Wishes(proposed=history))
    assert [station.target for station in plan.stations] == ["S1", "S2", "S1", "S2"]
    first, second = plan.stations[:2]
    assert "S1 near [400, 150, 60] mm, S2 near [300, -220, 90] mm" in first.how
    assert "proposed check" in first.how and "design" not in first.how
    assert "turning joints 1 up, 2 down, 3 up" in first.how
    assert "turning joints 1 down, 2 down, 3 up" in second.how
    assert first.posture_deg == pytest.approx(reaching(SEATS[0], NEAR[0]))
    assert plan.within_calibration  # an interim check like any other, though of other poses


def test_it_is_measured_to_its_end(command, history):  # noqa: F811
    points = [SEATS[i % 2] for i in range(4)]
    presses = [press(i, point) for i, point in enumerate(points, 1)]
    options = ["interim", "--proposed", "--history", str(history), "--then", "none", "--json"]
    code, lines, _ = command(*options, measurements=presses)
    told = [json.loads(line) for line in lines]
    assert code == 0 and told[-1]["finished"] and told[-1]["taken"] == 4
    assert told[0]["next"]["posture_deg"] == pytest.approx(reaching(SEATS[0], NEAR[0]), abs=0.1)


def test_a_table_of_poses_will_do_from_another_computer(tmp_path):
    poses_table(tmp_path / "poses.csv", [[20.0, 30.0, -40.0], [-40.0, 35.0, -45.0]])
    plan = make_plan("interim", ARM, None, Wishes(poses=tmp_path / "poses.csv", targets=["A", "B"]))
    assert plan.kind == "interim"
    assert [station.target for station in plan.stations] == ["A", "B"]


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"poses_deg": []}, "next_check: found no poses, expected a cause in doubt"),
        ({"arm": "ANOTHER"}, "arm: found 'ANOTHER'"),
        ({"schema": "armd.diagnosis/1"}, "schema: found another file"),
        ({"approach": ["+-+"]}, "next_check: found .* expected seats_mm"),
        ({"poses_deg": [[1.0, 2.0]] * 4}, "next_check: found .* expected seats_mm"),
        ({"poses_deg": [[1.0, 2.0, float("nan")]] * 4}, "next_check: found .* expected seats_mm"),
        ({"seats_mm": []}, "next_check: found .* expected seats_mm"),
    ],
)
def test_a_history_that_proposes_nothing_sound_is_refused(history, keys, said):
    changed(history, **keys)
    with pytest.raises(BadInput, match=said):
        make_plan("interim", ARM, None, Wishes(proposed=history))


def test_a_history_without_a_result_is_refused(tmp_path):
    with pytest.raises(BadInput, match=r"report.json: the file: found nothing"):
        make_plan("interim", ARM, None, Wishes(proposed=tmp_path))


@pytest.mark.parametrize(
    ("wishes", "said"),
    [
        ({"repeats": 3}, "--repeats: found it with --proposed"),
        ({"targets": ["S1"]}, "--targets: found 1 name, expected 2: seats"),
    ],
)
def test_it_says_itself_what_is_touched(history, wishes, said):
    with pytest.raises(BadInput, match=said):
        make_plan("interim", ARM, None, Wishes(proposed=history, **wishes))


def test_another_kind_or_no_history_is_refused(command, history):  # noqa: F811
    code, _, error = command("seats", "--proposed", "--history", str(history))
    assert code == 2 and "--proposed: found it with seats, expected it with interim only" in error
    code, _, error = command("interim", "--proposed")
    assert code == 2 and "--proposed: found it without a history" in error


def test_a_press_in_the_other_seat_is_refused(command, history):  # noqa: F811
    where = [SEATS[0], SEATS[1], SEATS[1], SEATS[0], SEATS[1]]
    presses = [press(i, point) for i, point in enumerate(where, 1)]
    options = ["interim", "--proposed", "--history", str(history), "--then", "none", "--json"]
    code, lines, _ = command(*options, measurements=presses)
    told = [json.loads(line) for line in lines]
    assert code == 0
    assert [line["event"] for line in told if line["event"] in ("reading", "refused")] == [
        *("reading", "reading", "refused", "reading", "reading"),
    ]
