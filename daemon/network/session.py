"""Open a Zenoh session with only the access that the configuration allows."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import zenoh

from armd.daemon.config import Config
from armd.errors import BadInput

#: A frozen daemon's points and token vanish after this; a killed one's at once.
LEASE_MS = 4000
CLOSE_S = 1.5
#: Batches of 64 kB that may wait for one subscriber: six seconds of points at 1 kHz. With Zenoh's
#: default of two, a subscriber that gets no processor for half a second loses points.
WAITING_BATCHES = 16
#: Clients send the daemon only short queries; Zenoh's default limit is a gigabyte.
MOST_RECEIVED_BYTES = 1 << 16
#: Time limit of a handshake, and connections that may be in it: with Zenoh's defaults of 10 s and
#: 100, a hundred silent connections block all others for ten seconds.
ACCEPT_MS, ACCEPTING = 2000, 500
#: All keys that are allowed. `**` matches no chunk that begins with @, and no pattern matches all
#: that do. So those in use are listed; others are neither received nor forwarded.
KEYS = ["**", "**/@raw", "**/@raw/**", "**/@daemon", "**/@adv/**", "@/**"]
#: Only the daemon may publish; others may query and subscribe. All other incoming messages are
#: dropped on every key, as `**` would include the arm's, except the key for rivals (rival.py).
ONLY_THE_DAEMON_SPEAKS = {
    "enabled": True,
    "default_permission": "deny",
    "rules": [
        {
            "id": "listen",
            "permission": "allow",
            "flows": ["ingress"],
            "messages": [
                "query",
                "declare_subscriber",
                "liveliness_query",
                "declare_liveliness_subscriber",
            ],
            "key_exprs": KEYS,
        },
        {
            "id": "rival",
            "permission": "allow",
            "flows": ["ingress"],
            "messages": ["put"],
            "key_exprs": ["**/@daemon"],
        },
        {
            "id": "speak",
            "permission": "allow",
            "flows": ["egress"],
            "messages": [
                "put",
                "delete",
                "query",
                "reply",
                "declare_subscriber",
                "declare_queryable",
                "liveliness_token",
                "liveliness_query",
                "declare_liveliness_subscriber",
            ],
            "key_exprs": KEYS,
        },
    ],
    "subjects": [{"id": "everybody"}],
    "policies": [{"rules": ["listen", "rival", "speak"], "subjects": ["everybody"]}],
}
UNIX_SOCKET = "unixsock-stream/"
SOCKET_MODE = 0o660  # the daemon's user and group may connect
RETRY = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2}


@contextmanager
def open_zenoh_session(config: Config) -> Iterator[zenoh.Session]:
    """Open a session as `open_session`, and close it at the end within `CLOSE_S`.

    A subscriber that does not respond delays Zenoh's own close for ten seconds. The end of the
    process closes the sockets too, and other clients see the token disappear in the same way.
    """
    session = open_session(config)
    try:
        yield session
    finally:
        closing = threading.Thread(target=_close, args=(session,), daemon=True)
        closing.start()
        closing.join(CLOSE_S)


def _close(session: zenoh.Session) -> None:
    with suppress(zenoh.ZError):
        session.close()  # type: ignore[no-untyped-call]


def open_session(config: Config) -> zenoh.Session:
    """Open Zenoh; raises `BadInput` if it cannot listen or the configuration is not Zenoh's."""
    zenoh_settings = config.file.zenoh
    if zenoh_settings.config is not None:
        path = config.resolve_path(zenoh_settings.config)
        try:
            settings = zenoh.Config.from_file(str(path))
        except zenoh.ZError as error:
            raise BadInput(path, "the file", str(error), "a Zenoh configuration") from error
    else:
        settings = zenoh.Config()
        for key, value in {
            "mode": zenoh_settings.mode,
            "listen/endpoints": zenoh_settings.listen,
            "connect/endpoints": zenoh_settings.connect,
            "connect/retry": RETRY,
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            "transport/unicast/accept_timeout": ACCEPT_MS,
            "transport/unicast/accept_pending": ACCEPTING,
            "transport/link/tx/lease": LEASE_MS,
            "transport/link/tx/queue/size/data": WAITING_BATCHES,
            "transport/link/rx/max_message_size": MOST_RECEIVED_BYTES,
            "access_control": ONLY_THE_DAEMON_SPEAKS,
        }.items():
            settings.insert_json5(key, json.dumps(value))
    # The cache of measurements and events needs time stamps.
    settings.insert_json5("timestamping/enabled", "true")
    try:
        session = zenoh.open(settings)
    except zenoh.ZError as error:
        location = "zenoh.config" if zenoh_settings.config else "zenoh.listen"
        problem = str(error).split(" at /")[0]
        raise BadInput(config.path, location, problem, "endpoints that can be opened") from error
    for endpoint in json.loads(settings.get_json("listen/endpoints")):
        if isinstance(endpoint, str) and endpoint.startswith(UNIX_SOCKET):
            Path(endpoint.removeprefix(UNIX_SOCKET)).chmod(SOCKET_MODE)
    return session
