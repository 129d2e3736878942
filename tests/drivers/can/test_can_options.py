"""`[driver]` of an arm on CAN: a key that nobody knows must not pass, whatever python-can says."""

import pytest

from armd.drivers.config import CanConfig
from armd.errors import BadInput
from armd.files.schema import Strict, validate


class File(Strict):
    driver: CanConfig


def check(**keys):
    return validate("armd.toml", {"driver": {"kind": "can", **keys}}, File).driver


@pytest.mark.parametrize(
    ("interface", "keys"),
    [
        ("socketcan", {"bitrate": 1_000_000, "local_loopback": True}),
        ("socketcand", {"host": "127.0.0.1", "port": 29536, "tcp_tune": False}),
        ("slcan", {"bitrate": 500_000, "tty_baudrate": 115200, "sleep_after_open": 0.1}),
        ("udp_multicast", {"port": 43113, "hop_limit": 0}),
        ("pcan", {"f_clock": 80_000_000, "auto_reset": True}),
        ("kvaser", {"single_handle": True, "driver_mode": True}),
        ("gs_usb", {"anything": "its library is not installed here"}),
    ],
)
def test_what_python_can_knows_passes(interface, keys):
    assert check(interface=interface, channel="x", **keys).model_extra == keys


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"rate": 250}, r"driver\.rate: found an unknown key, expected .*socketcan; rate_hz\?"),
        ({"rate_Hz": 250}, r"driver\.rate_Hz: found an unknown key.*rate_hz\?"),
        ({"bit_rate": 250_000}, r"driver\.bit_rate: found an unknown key.*bitrate\?"),
        ({"max_joint_rate_deg": 5}, r"driver\.max_joint_rate_deg: .*max_joint_rate_deg_s\?"),
        ({"host": "127.0.0.1"}, r"driver\.host: found an unknown key, expected .*socketcan"),
    ],
)
def test_a_typo_is_named(keys, message):
    with pytest.raises(BadInput, match=message):
        check(interface="socketcan", channel="can0", **keys)


def test_an_interface_that_is_none():
    with pytest.raises(BadInput, match=r"driver\.interface: found 'socketcam', expected one of"):
        check(interface="socketcam", channel="can0")


@pytest.mark.parametrize(
    ("interface", "keys", "missing"),
    [
        ("socketcand", {"channel": "can0", "port": 1}, "host"),
        ("socketcand", {"channel": "can0", "host": "x"}, "port"),
        ("slcan", {}, "channel"),
    ],
)
def test_what_the_interface_needs(interface, keys, missing):
    with pytest.raises(BadInput, match=rf"driver\.{missing}: found nothing, expected this key"):
        check(interface=interface, **keys)
