"""From box to certificate on a simulated SO-101, by the commands of docs/tutorials/so101.md.

    python tests/scenarios/so101.py [--seed N] [--folder FOLDER]

nominal → calibrated → diagnosed → verified, each figure printed. `check` and `verify` take no part
in calibration or diagnosis but as what the diagnosis holds out. Exit code 1 where a step does not
help, or the verdict is not passed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from support.program import ARMD

MPE = """\
schema = "armd.mpe/1"
decision = "simple"
[mpe]
spat_max_mm = 2.0
spat_2s_mm = 2.0
"""


def armd(*arguments: str, may_fail: bool = False) -> str:
    """Run one command as a person would; its output."""
    done = subprocess.run([*ARMD, *arguments], capture_output=True, text=True, check=False)
    if done.returncode and not may_fail:
        raise SystemExit(f"armd {' '.join(arguments)}\n{done.stdout}{done.stderr}")
    return done.stdout


def identified(folder: Path, arm: str, calibrate: str, check: str) -> dict[str, float]:
    """The 3-D RMS of *check* under each model, µm; the models and the diagnosis in *folder*."""
    cal, extended = str(folder / "calibration.json"), str(folder / "extended.json")
    armd("calibrate", calibrate, "--arm", arm, "-o", cal)
    armd(
        *("diagnose", calibrate, "--arm", arm, "--calibration", cal, "--holdout", check),
        *("--json", str(folder / "diagnosis.json"), "--extended", extended),
    )
    figures = {}
    for name, model in (("nominal", None), ("calibrated", cal), ("diagnosed", extended)):
        result = folder / f"{name}.json"
        with_model = [] if model is None else ["--calibration", model]
        armd("evaluate", check, "--arm", arm, *with_model, "--json", str(result))
        figures[name] = json.loads(result.read_text())["rms_um"]
        print(f"{name:12}{figures[name]:8.0f} µm 3-D RMS of the check", flush=True)
    return figures


def run(folder: Path, seed: int) -> dict[str, float]:
    """The 3-D RMS of the check under each model, µm, and the verification's largest deviation."""
    arm, measured = str(folder / "arm.toml"), folder / "measured"
    armd("arm", "so101", "-o", arm)
    truth = folder / "truth.json"
    armd(
        *("simulate", "--session", "so101", "-o", str(measured), "--seed", str(seed)),
        *("--truth-out", str(truth)),
    )
    calibrate, check, verify = (str(measured / n) for n in ("calibrate", "check", "verify"))
    figures = identified(folder, arm, calibrate, check)
    found = json.loads((folder / "diagnosis.json").read_text())["findings"]
    _print_findings(found, json.loads(truth.read_text()))
    mpe = folder / "mpe.toml"
    mpe.write_text(MPE)
    verdict = armd(
        *("verify", verify, "--arm", arm, "--calibration", str(folder / "extended.json")),
        *("--mpe", str(mpe)),
        may_fail=True,
    )
    print(verdict, end="")
    figures["passed"] = float("verdict: PASSED" in verdict)
    return figures


def _print_findings(findings: list[dict], truth: dict[str, list[float]]) -> None:
    """What was found, beside what is true, which the diagnosis never sees."""
    for finding in findings:
        place, cause = finding["location"], finding["cause"]
        true = truth.get(f"{cause}_arcsec")
        beside = ""
        if true is not None and place.startswith("joint "):
            found = sum(p["value"] ** 2 for p in finding["parameters"]) ** 0.5 * 206_265
            beside = f": {found:.0f}″, truly {true[int(place.split()[1]) - 1]:.0f}″"
        doubt = "" if finding["gain"]["shown"] else ", not confirmed by the check"
        print(f"  {cause} {place}{beside}, probability {finding['probability']:.2f}{doubt}")


def main(run: Callable[[Path, int], dict[str, float]] = run) -> int:
    """Prints what *run* measures in a folder, by a seed; 1 where a correction does not help or
    the arm does not pass."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="armd-so101-") as scratch:
        figures = run(args.folder or Path(scratch), args.seed)
    helped = figures["diagnosed"] <= figures["calibrated"] < figures["nominal"]
    return 0 if helped and figures["passed"] else 1


if __name__ == "__main__":
    sys.exit(main())
