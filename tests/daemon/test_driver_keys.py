"""`[driver]` through the command line: for every key of every kind, what cannot be meant is refused
with its file, key, found and expected, exit code 2 and nothing published; what can be is taken."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import get_args

import pytest

from armd.daemon import cli
from armd.daemon.config import load_config
from armd.drivers.config import DriverConfig
from support.selection import parametrize_default

JOINT = "[[joint]]\ncounts_per_turn = 4096\n"
ARM = 'schema = "armd.arm/1"\nserial_number = "A-1"\n[[temperature_sensor]]\nname = "t1"\n'
SERVOS = {"port": "'/dev/x'", "ids": "[1, 2, 3]", "temperature_ids": "[1]"}
#: kind, or kind and python-can's interface → the keys that it needs
GOOD = {
    "serial": {"port": "'/dev/x'"},
    "can socketcan": {"channel": "'can0'"},
    "can socketcand": {"channel": "'can0'", "host": "'here'", "port": "29536"},
    "can slcan": {"channel": "'/dev/x'"},
    "can udp_multicast": {},
    "feetech": SERVOS,
    "dynamixel": SERVOS,
    "dynamixel1": SERVOS,
    "microscribe": {"port": "'/dev/x'"},
    "replay": {"file": "'x.mcap'"},
}

NO_NUMBER = ["'1'", "true", "[1]", "nan", "inf", "-inf"]
NO_WHOLE = [*NO_NUMBER, "-1", "1.5", "1e300"]
NO_BAUD = [*NO_WHOLE, "0", "12", "9599", "12000001", "99999999999999999999"]
NO_NAME = ["''", "' '", "5", "true", "[]", r'"/dev/x\u0000"', r'"/dev/x\n"']
NO_BOOL = ["0", "1", "'true'", "[]"]
NO_RATE = [*NO_NUMBER, "-1", "0", "1e-300", "4.9", "2000.1", "1e300"]
NO_JOINT_RATE = [*NO_NUMBER, "-1", "0", "1e-300", "0.9", "20001", "1e300"]
NO_TIME = [*NO_NUMBER, "-0.1", "61", "1e300"]
NO_ID = ["-1", "253", "254", "1.5", "'1'", "true"]
NO_IDS = ["1", "[]", "[1, 1, 2]", "[1, 2]", "[1, 2, 3, 4]", *(f"[{i}, 2, 3]" for i in NO_ID)]
SERVO_KEYS = {
    "port": NO_NAME,
    "ids": NO_IDS,
    "rate_hz": NO_RATE,
    "temperature_ids": NO_IDS,
    "trigger": [
        "6",
        "{}",
        "{ id = 6 }",
        *(f"{{ id = {i}, pressed_below = 1900 }}" for i in NO_ID),
        *(f"{{ id = 6, pressed_below = {b} }}" for b in (*NO_WHOLE, "0", "4096")),
        "{ id = 6, pressed_below = 1900, colour = 1 }",
    ],
    "adapter_serial": NO_NAME,
    "torque_off": NO_BOOL,
    "return_delay_us": [*NO_WHOLE, "1", "509", "510"],
    "accept_changed_offsets": NO_BOOL,
    "max_joint_rate_deg_s": NO_JOINT_RATE,
}
BAD = {
    "serial": {"port": NO_NAME, "baud": NO_BAUD, "max_joint_rate_deg_s": NO_JOINT_RATE},
    "can socketcan": {
        "channel": [*NO_NAME[:2], "-1", *NO_NAME[3:]],
        "rate_hz": NO_RATE,
        "sync": ["''", "'both'", "1", "true"],
        "encoder_serial_numbers": [
            "1", "[]", "[1, 2]", "[1, 1, 2]", "[0, 1, 2]", "[-1, 1, 2]", "[4294967296, 1, 2]",
            "[1.5, 1, 2]", "['1', 2, 3]", "[1, 2, 3, 4]",
        ],
        "max_joint_rate_deg_s": NO_JOINT_RATE,
        "bitrate": [*NO_WHOLE, "0", "12", "1000001"],
        "data_bitrate": [*NO_WHOLE, "0", "12", "8000001"],
        "fd": NO_BOOL,
        "receive_own_messages": NO_BOOL,
        "local_loopback": NO_BOOL,
        "sjw": NO_WHOLE,
    },
    "can socketcand": {"host": NO_NAME, "port": [*NO_WHOLE, "0", "65536"], "tcp_tune": NO_BOOL},
    "can slcan": {
        "bitrate": [*NO_WHOLE, "0", "12", "1000001"],
        "tty_baudrate": NO_BAUD,
        "sleep_after_open": NO_TIME,
        "timeout": NO_TIME,
        "rtscts": NO_BOOL,
        "listen_only": NO_BOOL,
        "btr": NO_NAME,
    },
    "can udp_multicast": {
        "port": [*NO_WHOLE, "0", "65536"], "hop_limit": [*NO_WHOLE, "256"], "channel": ["-1"],
    },
    "feetech": {**SERVO_KEYS, "baud": [*NO_BAUD, "9600", "250001", "2000000"]},
    "dynamixel": {**SERVO_KEYS, "baud": [*NO_BAUD, "38400", "250000", "10500000"]},
    "dynamixel1": {**SERVO_KEYS, "baud": [*NO_BAUD, "38400", "250001", "2000000"]},
    "microscribe": {
        "port": NO_NAME,
        "baud": [*NO_BAUD, "230400", "1000000"],
        "stream": NO_BOOL,
        "max_joint_rate_deg_s": NO_JOINT_RATE,
    },
    "replay": {"file": NO_NAME, "speed": [*NO_NUMBER, "-1", "1e-300", "0.0009", "1001", "1e300"]},
}  # fmt: skip
FINE = {
    "serial": {"baud": ["9600", "921600", "12000000"], "max_joint_rate_deg_s": ["1", "20_000.0"]},
    "can socketcan": {
        "channel": ["0", "'vcan1'"],
        "rate_hz": ["5", "2000"],
        "sync": ["'follower'"],
        "encoder_serial_numbers": ["[1, 2, 4294967295]"],
        "bitrate": ["10000", "125_000", "1_000_000"],
        "local_loopback": ["true"],
    },
    "can socketcand": {"port": ["1", "65535"]},
    "can slcan": {
        "tty_baudrate": ["115200"], "sleep_after_open": ["0", "2"], "timeout": ["0.001"],
        "rtscts": ["false"], "btr": ["'031C'"],
    },
    "can udp_multicast": {"hop_limit": ["0", "255"]},
    "feetech": {
        "baud": ["38400", "76800", "1_000_000"],
        "ids": ["[0, 252, 9]"],
        "temperature_ids": ["[252]"],
        "rate_hz": ["5", "200.5"],
        "return_delay_us": ["0", "508"],
        "trigger": ["{ id = 0, pressed_below = 4095 }"],
        "adapter_serial": ["'5A68'"],
    },
    "dynamixel": {"baud": ["9600", "57600", "4_500_000"]},
    "dynamixel1": {"baud": ["9600", "57600", "3_000_000"]},
    "microscribe": {"baud": ["9600", "14400", "115200"]},
    "replay": {"speed": ["0", "0.001", "1000"]},
}  # fmt: skip


def of(table: dict[str, dict[str, list[str]]]) -> list[tuple[str, str, str]]:
    return [
        (kind, key, value)
        for kind, keys in table.items()
        for key, values in keys.items()
        for value in values
    ]


def written(folder: Path, kind: str, **keys: str) -> Path:
    name, _, interface = kind.partition(" ")
    joints = 5 if name == "microscribe" else 3
    (folder / "arm.toml").write_text(ARM + joints * JOINT)
    given = {"kind": f"'{name}'"} | ({"interface": f"'{interface}'"} if interface else {})
    lines = [f"{key} = {value}\n" for key, value in (given | GOOD[kind] | keys).items()]
    path = folder / "armd.toml"
    path.write_text("schema = 'armd.daemon/1'\narm = 'arm.toml'\n[driver]\n" + "".join(lines))
    return path


def refusal(path: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """What `armd run` says, which must be one line, with exit code 2."""
    assert cli.main(["run", "--allow-root", str(path)]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    return err.removeprefix("armd: ").rstrip()


@parametrize_default(("kind", "key", "value"), of(BAD), default=range(0, 1000, 4))
def test_what_cannot_be_is_refused(tmp_path, capsys, kind, key, value):
    path = written(tmp_path, kind, **{key: value})
    said = refusal(path, capsys)
    assert said.startswith(f"{path}: driver.{key}")
    where, found, expected = said.removeprefix(f"{path}: ").partition(": found ")
    found, _, expected = expected.partition(", expected ")
    assert where and found and expected


@pytest.mark.parametrize(("kind", "key", "value"), of(FINE))
def test_what_can_be_is_taken(tmp_path, kind, key, value):
    driver = load_config(written(tmp_path, kind, **{key: value})).driver
    assert key in driver.model_fields_set | set(driver.model_extra or {})


def test_every_key_of_every_kind_is_among_them():
    tried = {kind: set(keys) for kind, keys in BAD.items()}
    tried["can"] = set(chain.from_iterable(tried.pop(kind) for kind in list(tried) if " " in kind))
    union, _ = get_args(DriverConfig)
    for model in get_args(union):
        for kind in get_args(model.model_fields["kind"].annotation):
            assert set(model.model_fields) - {"kind", "interface"} <= tried[kind], kind


FEETECH = "[driver]\nkind = 'feetech'\nport = 'x'\n"


@pytest.mark.parametrize(
    ("driver", "said"),
    [
        ("[driver]", "driver.kind: found nothing, expected this key"),
        ("[driver]\nkind = 5", "driver.kind: found 5, expected one of 'serial'"),
        ("[driver]\nkind = ['can']", "driver.kind: found ['can'], expected one of 'serial'"),
        ("driver = 5", "driver: found 5, expected"),
        ("[driver]\nkind = 'can'\ninterface = ''", "driver.interface: found '', expected one of"),
        ("[driver]\nkind = 'can'\ninterface = 'socketcan'", "driver.channel: found nothing, exp"),
        ("[driver]\nkind = 'serial'\nport = 'x'\nport = 'y'", "TOML: found Cannot overwrite"),
        ("[driver]\nkind = 'serial'\nport = 'x'\nids = [1]", "driver.ids: found an unknown key"),
        (f"{FEETECH}ids = [1, 2]", "driver.ids: found 2 entries"),
        (f"{FEETECH}ids = [1, 2, 3, 4]", "driver.ids: found 4 servos"),
        (f"{FEETECH}ids = [1, 2, 2]", "driver.ids: found [1, 2, 2]"),
        (f"{FEETECH}ids = [1, 2, 3]\nid = 3", "driver.id: found an unknown key"),
        (
            f"{FEETECH}ids = [1, 2, 3]\ntemperature_ids = [1, 2]\n",
            "driver.temperature_ids: found 2 servos",
        ),
    ],
)
def test_kinds_and_keys_that_are_none(tmp_path, capsys, driver, said):
    path = written(tmp_path, "serial")
    path.write_text(f"schema = 'armd.daemon/1'\narm = 'arm.toml'\n{driver}\n")
    assert refusal(path, capsys).startswith(f"{path}: {said}")


def test_an_arm_that_the_wire_cannot_carry(tmp_path, capsys):
    path = written(tmp_path, "microscribe")
    (tmp_path / "arm.toml").write_text(ARM + 6 * JOINT)
    said = refusal(path, capsys)
    assert said == f"{tmp_path}/arm.toml: joint: found 6 joints, expected 5, a MicroScribe's"
    path = written(tmp_path, "can socketcan")
    sensors = "".join(f'[[temperature_sensor]]\nname = "s{i}"\n' for i in range(12))
    (tmp_path / "arm.toml").write_text(ARM + sensors + 3 * JOINT)
    said = refusal(path, capsys)
    assert said.startswith(
        f"{tmp_path}/arm.toml: temperature_sensor: found 13 sensors, expected 12"
    )
