"""The six commands of the README from Python, written by docs/how-to/python.md alone."""

import json
import subprocess
from pathlib import Path

import armd


def simulate(kind: str, folder: str, *more: str) -> None:
    """Take measured sessions of a simulated arm; your own folders do as well."""
    command = ["armd", "simulate", "--session", kind, "-o", folder, *more]
    subprocess.run(command, check=True)


simulate("calibration", "measured")
calibration = armd.calibrate(sorted(Path("measured").glob("T*")), "measured/arm.toml")
calibration.save("calibration.json")
calibration.report("calibration.html")
print(calibration)

simulate("verify", "test")
verification = armd.verify("test/verify", "measured/arm.toml", "calibration.json")
print(verification)

simulate("diagnosis", "sick", "--plant", "encoder_eccentricity@joint 3=1.5")
diagnosis = armd.diagnose(sorted(Path("sick").glob("session-*")), "sick/arm.toml")
print(diagnosis)
Path("diagnosis.json").write_text(json.dumps(diagnosis.to_dict()), encoding="utf-8")
if diagnosis.extended is not None:
    diagnosis.extended.save("extended.json")
