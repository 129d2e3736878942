"""What may not come again where a finding is taken out."""

from types import SimpleNamespace
from typing import Any

from armd.compensation.diagnose.search import find_rival_sets
from armd.compensation.effects.encoder import encoder_periodic


def test_where_a_curve_is_taken_out_its_orders_may_stand_beside_others() -> None:
    facts: Any = SimpleNamespace(joints=(2, 3))
    of_place = [c for c in encoder_periodic.list_candidates(facts) if c.location.joint == 3]
    elsewhere = next(c for c in encoder_periodic.list_candidates(facts) if c.location.joint == 2)
    curve = next(c for c in of_place if c.setting[0][0] == "highest order")
    whole, as_free = find_rival_sets._list_exclusions(curve)
    assert all(map(whole, of_place)) and not whole(elsewhere) and not as_free(elsewhere)
    able = {c.setting[0] for c in of_place if not as_free(c)}
    assert able == {("order", float(k), "1/turn") for k in encoder_periodic.ORDERS}
    (only,) = find_rival_sets._list_exclusions(
        next(c for c in of_place if c.setting[0][0] == "order")
    )
    assert all(map(only, of_place))
