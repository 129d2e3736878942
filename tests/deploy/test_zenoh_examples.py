"""deploy/zenoh/plant-arm.json5 protects a daemon as the daemon's own configuration does."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import zenoh

from armd.daemon.network import session

ZENOH = Path(__file__).resolve().parents[2] / "deploy" / "zenoh"
#: What the daemon sets without a file, by Zenoh's key (daemon/network/session.py).
OWN = {
    "transport/unicast/accept_timeout": session.ACCEPT_MS,
    "transport/unicast/accept_pending": session.ACCEPTING,
    "transport/link/tx/lease": session.LEASE_MS,
    "transport/link/tx/queue/size/data": session.WAITING_BATCHES,
    "transport/link/rx/max_message_size": session.MOST_RECEIVED_BYTES,
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
}


def access(path: str) -> dict[str, Any]:
    """Its rules by name, each as sets, with the policies that apply them."""
    given = json.loads(zenoh.Config.from_file(str(ZENOH / path)).get_json("access_control"))
    return comparable(given)


def comparable(given: dict[str, Any]) -> dict[str, Any]:
    """*given* without the order of its lists and the keys that say nothing."""
    rules = {
        rule["id"]: {
            key: sorted(value) if isinstance(value, list) else value
            for key, value in rule.items()
            if value is not None
        }
        for rule in given["rules"]
    }
    policies = sorted(
        (sorted(policy["rules"]), sorted(policy["subjects"])) for policy in given["policies"]
    )
    subjects = [
        {key: value for key, value in subject.items() if value is not None}
        for subject in given["subjects"]
    ]
    return {
        "enabled": given["enabled"], "default": given["default_permission"], "rules": rules,
        "policies": policies, "subjects": subjects,
    }  # fmt: skip


def test_a_plants_arm_lets_the_daemon_alone_speak_as_an_arm_without_a_file_does() -> None:
    assert access("plant-arm.json5") == comparable(session.ONLY_THE_DAEMON_SPEAKS)


@pytest.mark.parametrize("key", OWN)
def test_a_plants_arm_has_the_daemons_own_limits(key: str) -> None:
    config = zenoh.Config.from_file(str(ZENOH / "plant-arm.json5"))
    assert json.loads(config.get_json(key)) == OWN[key]


def test_what_the_daemon_sets_without_a_file_is_all_compared(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A limit that is new in session.py has to be in the file, too."""
    set_keys: list[str] = []

    class Config:
        def insert_json5(self, key: str, value: str) -> None:
            set_keys.append(key)

    def refuse(_: Config) -> None:
        raise zenoh.ZError("not opened")

    class Given:
        config, mode, listen, connect = None, "peer", ["tcp/127.0.0.1:0"], ()

    class Daemon:
        path = tmp_path

        class file:
            zenoh = Given

    monkeypatch.setattr(session.zenoh, "Config", Config)
    monkeypatch.setattr(session.zenoh, "open", refuse)
    with pytest.raises(Exception, match="not opened"):
        session.open_session(Daemon)  # type: ignore[arg-type]
    where = {"mode", "listen/endpoints", "connect/endpoints", "connect/retry"}
    assert set(set_keys) - where - {"access_control", "timestamping/enabled"} == set(OWN)
