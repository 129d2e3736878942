"""The help text below the options of a command: examples, units, exit codes, the page.

There is one entry per command except `simulate`, a separate program (`simulator/options.py`). A
test checks the examples against the options, and the exit codes against the commands.
"""

from __future__ import annotations

from armd.terminal.parser import Usage

LIVE_UNITS = "mm, °C, seconds; angles as the wire has them in rad; time stamps in Unix nanoseconds"
FILE_UNITS = "mm, °C, seconds; angles in files in degrees, in readings as session.toml says"

USAGE = {
    "demo": Usage(
        ("armd demo", "armd demo --seconds 20"), "how-to/simulate.md", LIVE_UNITS,
        "samples were lost",
    ),
    "run": Usage(("armd run armd.toml",), "reference/configure.md", LIVE_UNITS),
    "accept": Usage(("armd accept armd.toml",), "reference/servo.md"),
    "watch": Usage(
        ("armd watch", "armd watch SIM-0001 --json --seconds 5"),
        "reference/subscriber.md", LIVE_UNITS
    ),
    "status": Usage(("armd status",), "how-to/troubleshoot.md", LIVE_UNITS, "the arm is not ready"),
    "tip": Usage(
        ("armd tip list", "armd tip use ball3", "armd tip calibrate tip-session",
         "armd tip apply ball3"), "how-to/measure.md",
        "mm", "the tip's calibration leaves doubts, which it names",
    ),
    "reload": Usage(("armd reload",), "how-to/install.md"),
    "record": Usage(
        ("armd record -o morning.mcap", "armd record --session calibrate"),
        "how-to/record-export.md",
        LIVE_UNITS, "frames were lost, or the session has no reading",
    ),
    "replay": Usage(
        ("armd replay morning.mcap",), "how-to/record-export.md", LIVE_UNITS,
        "the points are not those that were recorded",
    ),
    "view": Usage(
        ("armd view", "armd view SIM-0001 --allow-commands"), "how-to/view.md",
        "mm, °C, K/h; standard deviations and uncertainties in a list in µm",
    ),
    "ippdme": Usage(
        ("armd ippdme", "armd ippdme --listen 192.0.2.10:1294 --alias PROBE1.TIP1A0B0=ball3"),
        "how-to/ippdme.md", "mm, degrees, °C, seconds, as I++ DME has them",
    ),
    "ros2": Usage(
        ("armd ros2 --router tcp/ros-host.example:7447", "armd ros2 --urdf arm.urdf"),
        "how-to/ros2.md",
        "metres and radians, as ROS has them",
    ),
    "fleet": Usage(
        ("armd fleet --endpoint tcp/plant.example:7447", "armd fleet --json"), "how-to/fleet.md",
        LIVE_UNITS,
    ),
    "stream": Usage(
        ("armd stream --format csv", "armd stream --template '{x:.3f};{y:.3f};{z:.3f}'"),
        "how-to/record-export.md", "mm; uncertainties in a template in µm",
    ),
    "export": Usage(
        ("armd export -o points.csv", "armd export measured.jsonl -o points.xyz"),
        "how-to/record-export.md",
        "mm, rad, °C; a .mcap for Foxglove in metres",
    ),
    "measure": Usage(
        (
            "armd measure seats -o measured",
            "armd measure artefact --artefact beam.toml -o measured",
            "armd measure verify -o verify",
        ),
        "how-to/measure.md", "mm, °C, seconds", "not finished: the same command takes it up again",
    ),
    "feature": Usage(
        ("armd feature sphere table.csv", "armd feature distance plane=table.csv:1-9 sphere=b.csv"),
        "how-to/measure.md", "mm and degrees, in the base frame",
    ),
    "correct": Usage(
        ("armd correct readings.csv --arm arm.toml --calibration calibration.json -o points.csv",),
        "how-to/offline.md", FILE_UNITS,
    ),
    "interim": Usage(
        (
            "armd interim add check-2026-03-18 --arm arm.toml --calibration calibration.json "
            "--history checks",
            "armd interim report --history checks --report checks.html",
        ),
        "how-to/interim.md", FILE_UNITS, "the arm has changed",
    ),
    "recorrect": Usage(
        (
            "armd recorrect measured.jsonl --arm arm.toml --calibration calibration-2.json "
            "-o again.csv",
        ),
        "how-to/interim.md", FILE_UNITS,
    ),
    "calibrate": Usage(
        (
            "armd calibrate measured/T15 measured/T20 measured/T25 --arm arm.toml "
            "-o calibration.json --report calibration.html",
        ),
        "how-to/calibrate.md", FILE_UNITS,
    ),
    "evaluate": Usage(
        ("armd evaluate check --arm arm.toml --calibration calibration.json",),
        "how-to/calibrate.md",
        FILE_UNITS + "; residuals in µm",
    ),
    "verify": Usage(
        (
            "armd verify verify --arm arm.toml --calibration calibration.json --mpe mpe.toml "
            "--report verify.html",
        ),
        "how-to/verify.md", FILE_UNITS + "; errors in µm",
        "the arm does not meet its limits, or not all of them were tested",
    ),
    "diagnose": Usage(
        (
            "armd diagnose calibrate --arm arm.toml --calibration calibration.json "
            "--holdout check --json diagnosis.json --extended extended.json",
        ),
        "how-to/diagnosis.md", FILE_UNITS + "; sizes in µm at the tip",
    ),
    "design": Usage(
        (
            "armd design --arm arm.toml --lowest 0 -o poses.csv --report poses.html",
            "armd design calibrate --arm arm.toml -o poses.csv --report poses.html",
        ),
        "how-to/diagnosis.md",
        FILE_UNITS + "; in the table of a first calibration q1 … in rad, too",
    ),
    "model": Usage(
        (
            "armd model arm.toml --calibration calibration.json --like robot.urdf "
            "-o corrected.urdf",
            "armd model arm.toml --calibration calibration.json --at-c 22 "
            "-o default_kinematics.yaml",
            "armd model arm.toml --calibration calibration.json -o corrections.csv",
        ),
        "how-to/model.md",
        "mm, degrees, °C; in a URDF and default_kinematics.yaml metres and radians",
    ),
    "compensate": Usage(
        (
            "armd compensate table.csv --arm arm.toml --calibration calibration.json "
            "-o commands.csv",
        ),
        "how-to/model.md", FILE_UNITS, "a row has no command: see its status",
    ),
    "check": Usage(
        ("armd check arm.toml armd.toml measured/T20",), "reference/configure.md", "",
        "a file has faults, each reported in a line",
    ),
    "init": Usage(
        (
            "armd init my-arm",
            "armd init my-arm --from robot.urdf --serial-number ARM-7 --port /dev/ttyUSB0",
            "armd init my-arm --from rows.csv",
        ),
        "how-to/import.md", FILE_UNITS,
    ),
    "import": Usage(
        (
            "armd import readings.xlsx --arm arm.toml -o measured",
            "armd import readings.csv --arm arm.toml --column q1='Base axis' -o measured",
            "armd import robot.urdf -o arm.toml",
        ),
        "how-to/import.md", "of the table by its headers; of a session mm, °C, s",
    ),
    "schema": Usage(
        ("armd schema arm", "armd schema arm -o arm.schema.json"),
        "reference/formats.md", FILE_UNITS
    ),
    "doctor": Usage(
        ("armd doctor", "armd doctor --json"), "how-to/doctor.md", "", "something stands in the way"
    ),
    "arm": Usage(("armd arm list", "armd arm so101 -o arm.toml"), "tutorials/so101.md", FILE_UNITS),
    "completion": Usage(("armd completion bash",), "how-to/install.md"),
    "man": Usage(("armd man",), "how-to/install.md"),
}  # fmt: skip
