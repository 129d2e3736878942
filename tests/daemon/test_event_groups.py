"""A flood of events of one kind is told as a few."""

from armd.daemon.event_groups import BURST, EventGroups
from armd.drivers.sample import Event

S = 1_000_000_000


def reboot(k, kind="reboot"):
    return Event(kind, f"reboot {k}", k, "warning", {"k": k})


def told(groups, events):
    """What is published of (event, instant), with a tick every 50 ms."""
    out, tick_ns = [], 0
    for event, at_ns in events:
        while tick_ns <= at_ns:
            out += groups.take_due_events(tick_ns)
            tick_ns += S // 20
        if event is None:
            continue
        if groups.pass_on(event, at_ns):
            out.append(event)
    return out


def test_of_a_flood_the_first_are_told_and_the_rest_is_counted():
    n, seconds = 17_177, 12
    flood = [(reboot(k), k * seconds * S // n) for k in range(n)]
    out = told(EventGroups(), [*flood, (None, 100 * S)])
    assert len(out) < 30
    grouped = sum(event.detail["grouped"] for event in out if "grouped" in event.detail)
    single = sum("grouped" not in event.detail for event in out)
    assert single >= BURST and single + grouped == n  # none is lost
    assert out[-1].detail["last"] == {"k": n - 1} and "more reboot events in" in out[-1].text


def test_a_slow_flood_of_minutes_is_a_few_lines():
    """Seven minutes of four a second, of four kinds in turn."""
    kinds = ("joint_invalid", "joint_valid", "temperature_missing", "temperature_back")
    events = [(reboot(k, kinds[k % 4]), k * S // 4) for k in range(7 * 60 * 4)]
    assert len(told(EventGroups(), events)) < 1784 / 10


def test_losses_and_recoveries_are_told_one_by_one():
    events = [(reboot(k, ("silence", "recovered")[k % 2]), k * 2 * S) for k in range(500)]
    assert len(told(EventGroups(), events)) == 500


def test_after_a_flood_the_next_loss_is_told_at_once():
    flood = [(reboot(k), k) for k in range(100)]
    late = reboot(1000)
    out = told(EventGroups(), [*flood, (None, 60 * S), (late, 60 * S)])
    assert out[-1] == late


def test_a_press_and_a_state_are_never_summed_up():
    groups = EventGroups()
    for kind in ("button", "state"):
        assert all(groups.pass_on(reboot(k, kind), k) for k in range(1000))
