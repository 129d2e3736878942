"""`armd calibrate` and `armd diagnose` call the same readings of one session outliers."""

from dataclasses import replace

import numpy as np

from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.report.result import as_json
from armd.compensation.identify.calibrate import Options, calibrate
from support import synthetic
from support.selection import parametrize_default

ARM = synthetic.arm()
READINGS = 240
WRONG = 7  # 3 %
ENCODER_RAD = 5e-5  # about 30 µm at the tip


def measured(seed: int, heavy: bool) -> tuple[Session, list[int]]:
    """A session with gross errors, ten to a hundred times the noise, and their rows from 1;
    *heavy*: the noise has tails of Student's t of three degrees of freedom."""
    rng = np.random.default_rng(seed)
    session = synthetic.session(ARM, synthetic.disturbed(ARM, rng, 0.3), rng, readings=READINGS)
    noise = rng.normal(size=(READINGS, 6))
    if heavy:
        noise /= np.sqrt(rng.chisquare(3.0, (READINGS, 1)) / 3.0)
    q = session.states.q + ENCODER_RAD * noise
    wrong = rng.choice(READINGS, WRONG, replace=False)
    q[wrong, 1] += rng.uniform(20.0, 200.0, WRONG) * ENCODER_RAD
    return replace(session, states=replace(session.states, q=q)), sorted((wrong + 1).tolist())


@parametrize_default("heavy", [False, True])
def test_both_name_the_same_rows(heavy: bool) -> None:
    session, wrong = measured(3, heavy)
    result = calibrate([session], ARM, Options(thermal_order=0))
    named = [o["row"] for o in result.as_json()["outliers"]]
    told = as_json(diagnose([session], ARM), None)["findings"]
    diagnosed = [o["row"] for f in told if f["cause"] == "outliers" for o in f["rows"]]
    assert named == sorted(diagnosed)
    # Of tails beside gross errors one may be named in every third data set (docs/decisions/0025).
    assert len(set(named) - set(wrong)) <= heavy and len(set(named) & set(wrong)) >= WRONG - 2
    # Tails are weighed down as before, and no outliers.
    assert (len(result.fit.down_weighted) > WRONG + 3) == heavy
