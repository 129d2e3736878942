"""A ROS node in the conventions of rmw_zenoh: keys, liveliness tokens, attachments."""

from __future__ import annotations

import hashlib
import re
import struct
import time
from collections.abc import Iterable
from dataclasses import dataclass

import zenoh
from zenoh import ext

from armd.daemon.bridges.ros2.messages import MessageType

NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
NODE_ID = 0


@dataclass(frozen=True)
class Quality:
    """The quality of service: history depth, and whether late subscribers get the history.

    All other settings are rmw_zenoh's defaults.
    """

    depth: int
    transient_local: bool = False

    @property
    def token(self) -> str:
        """Reliability, durability, history and depth, deadline, lifespan, liveliness."""
        return f":{1 if self.transient_local else ''}:,{self.depth}:,:,:,,"


def make_legal_name(serial: str) -> str:
    """Convert a serial number to a name that ROS accepts."""
    name = re.sub(r"\W", "_", serial, flags=re.ASCII)
    return f"arm_{name}" if name[0].isdigit() else name


def escape(name: str) -> str:
    """Escape a name for use within one part of a liveliness token."""
    return name.replace("/", "%")


class TopicPublisher:
    """One topic of a node."""

    def __init__(self, session: zenoh.Session, key: str, token: str, quality: Quality) -> None:
        self._session, self._key, self._depth = session, key, quality.depth
        self._past: ext.AdvancedPublisher | None = None
        # Never BEST_EFFORT: receivers up to Zenoh 1.5.1 lose messages if a link has both this and
        # RELIABLE.
        self._publisher: zenoh.Publisher | ext.AdvancedPublisher
        drop = zenoh.CongestionControl.DROP
        if quality.transient_local:
            self._publisher = ext.declare_advanced_publisher(
                session,
                key,
                congestion_control=drop,
                cache=ext.CacheConfig(max_samples=quality.depth),
                publisher_detection=True,
                sample_miss_detection=ext.MissDetectionConfig(
                    heartbeat=None, sporadic_heartbeat=500
                ),
            )
        else:
            self._publisher = session.declare_publisher(key, congestion_control=drop)
        self._token = session.liveliness().declare_token(token)
        self._gid = hashlib.sha256(token.encode()).digest()[:16]
        self._sequence = 0

    def put(self, message: bytes) -> None:
        self._publisher.put(message, attachment=self._attachment())

    def put_past(self, messages: Iterable[bytes]) -> None:
        """Publish past messages only for subscribers that want history (transient local).

        It works for present and later subscribers. A separate publisher sends to nobody and only
        answers requests for history from its cache.
        """
        self._past = ext.declare_advanced_publisher(
            self._session,
            self._key,
            allowed_destination=zenoh.Locality.SESSION_LOCAL,
            cache=ext.CacheConfig(max_samples=self._depth),
            publisher_detection=True,
        )
        for message in messages:
            self._past.put(message, attachment=self._attachment())

    def _attachment(self) -> bytes:
        self._sequence += 1
        return struct.pack("<qqB16s", self._sequence, time.time_ns(), 16, self._gid)


class RosNode:
    """The node `/<namespace>/armd` in a ROS domain, on a session that reaches its router."""

    def __init__(self, session: zenoh.Session, domain: int, namespace: str) -> None:
        self._session = session
        self._domain = domain
        self._zid = str(session.zid())
        self._node = f"%/{escape(f'/{namespace}')}/armd"
        self._publishers = 0
        head = f"@ros2_lv/{domain}/{self._zid}/{NODE_ID}"
        self._token = session.liveliness().declare_token(f"{head}/{NODE_ID}/NN/{self._node}")

    def publisher(self, topic: str, kind: MessageType, quality: Quality) -> TopicPublisher:
        """Return a publisher; *topic* is the full name with its leading slash."""
        self._publishers += 1
        key = f"{self._domain}/{topic.strip('/')}/{kind.dds}/{kind.hash}"
        token = "/".join(
            [
                f"@ros2_lv/{self._domain}/{self._zid}/{NODE_ID}/{self._publishers}/MP",
                self._node,
                escape(topic),
                kind.dds,
                kind.hash,
                quality.token,
            ]
        )
        return TopicPublisher(self._session, key, token, quality)
