"""Keeps checks in a history, each by a process of its own that is killed at a random moment.

    killed_writer.py CHECKS HISTORY KILLS SEED

Prints as JSON how often the process was killed before it ended, and how often a check was there
afterwards although. Exits with an error where a history is then anything but that of before or of
after, or where a check that is added again is not as it would have been.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import time
from pathlib import Path

import numpy as np

from armd.compensation.data.sessions.session import load_sessions
from armd.compensation.interim.checks import chain, history, keeping
from armd.compensation.interim.checks.columns import list_causes
from armd.compensation.interim.checks.reduce import reduce
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import load_calibration


def main() -> None:
    checks, folder, kills, seed = Path(sys.argv[1]), Path(sys.argv[2]), *map(int, sys.argv[3:])
    arm = load_arm(checks / "arm.toml")
    calibration = load_calibration(checks / "calibration.json", arm)
    causes = list_causes(arm, calibration.content)
    new = [
        keeping.NewCheck(session, reduce(session, arm, calibration.content, causes))
        for session in load_sessions(sorted(checks.glob("day-*")), arm)
    ]

    def keep(number: int) -> None:
        with keeping.lock_history(folder):
            lines = chain.read_chain(folder).lines
            keeping.check_new(folder, lines, [keeping.CheckDate.from_session(new[number].session)])
            keeping.keep(folder, lines, [new[number]], checks / "arm.toml", calibration)

    begun = time.monotonic()
    keep(0)
    usual_s = time.monotonic() - begun
    rng = np.random.default_rng(seed)
    there, killed, kept_though = 1, 0, 0
    for _ in range(kills):
        if there == len(new):
            shutil.rmtree(folder)
            there = 0
        child = os.fork()
        if child == 0:
            keep(there)
            os._exit(0)
        time.sleep(float(rng.uniform(0.0, 1.2 * usual_s)))
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        cut = os.WIFSIGNALED(status)
        lines = chain.read_chain(folder).lines
        loaded = history.load(folder) if lines else []
        names = [check.line.name for check in loaded]
        expected = [one.session.name for one in new[: len(names)]]
        assert names == expected and len(names) in (there, there + 1), (names, there)
        for check, one in zip(loaded, new, strict=False):
            np.testing.assert_allclose(check.reduced.residual, one.reduced.residual, rtol=1e-6)
        assert cut or len(names) == there + 1
        killed += cut
        usual_s *= 1.05 if cut else 0.9  # as fast as this machine is just now
        kept_though += cut and len(names) == there + 1
        there = len(names)
    print(json.dumps({"killed": killed, "kept_though": kept_though}))


main()
