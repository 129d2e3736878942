"""What `make hidden-predictive` asks of each cause, and one case of it."""

import numpy as np
import pytest
from predictive_numbers import SMALL, WITHOUT, Task, carry_out, own_variables

from armd.simulator.plants.causes import CAUSES
from armd.simulator.plants.draw import draw_plant


def test_every_cause_has_variables_that_are_recorded() -> None:
    rng = np.random.default_rng(1)
    numbered = {f"{kind}{k}" for kind in "qwt" for k in range(10)}
    others = {"artefact_c", "time_s", "placement", "target", "approach"}
    for cause in CAUSES:
        if cause not in WITHOUT:
            own = own_variables(draw_plant(rng, [cause]))
            assert own and own <= numbered | others, cause


@pytest.mark.slow
def test_a_links_growth_shows_along_the_link_over_its_own_temperature() -> None:
    found = carry_out(Task("link_expansion", 7_014_010, SMALL))
    assert found is not None and found.snr > 8.0
    assert found.is_own and found.first[1].startswith("length link"), found
    assert found.least_p[0] < 0.05 < found.least_p[1]
