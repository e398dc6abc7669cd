"""A node in the graph of ROS 2, made of a Zenoh session: publishers, subscribers, and tokens that tell of them."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from hashlib import blake2s
from typing import Any, Self

import zenoh
import zenoh.ext

from agent.shell.ros2.wire import (
    NODE,
    PUBLISHER,
    SUBSCRIBER,
    Endpoint,
    Quality,
    attachment,
    joined,
    kind_in,
    to_bytes,
    token,
    tokens_of,
)
from protocol.session import at_once


class RosPublisher:
    """Says messages on one topic."""

    def __init__(self, endpoint: Endpoint, publisher: Any, told: str) -> None:
        """told: its token."""
        self._endpoint, self._publisher = endpoint, publisher
        self._gid = blake2s(told.encode(), digest_size=16).digest()
        self._sequence = 0

    def put(self, message: Any) -> None:
        """Say a message of the topic's type."""
        self._sequence += 1
        attached = attachment(self._sequence, time.time_ns(), self._gid)
        self._publisher.put(to_bytes(self._endpoint.kind, message), attachment=attached)


class RosNode:
    """Declares what a node has; leaving the context takes all back."""

    def __init__(self, session: zenoh.Session, domain: int, namespace: str, name: str) -> None:
        """namespace: such as /r1, or / for none."""
        self._session, self._domain, self._namespace, self._name = session, domain, namespace, name
        self._declared = ExitStack()
        self._number = 0
        self._tell(NODE)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._declared.close()

    def _tell(self, what: str, rest: str = "") -> str:
        """Declare the next token."""
        zid = str(self._session.info.zid())
        told = token(self._domain, zid, self._number, what, self._namespace, self._name, rest)
        self._number += 1
        self._declared.enter_context(self._session.liveliness().declare_token(told))
        return told

    def name_of(self, topic: str) -> str:
        """A topic with its namespace."""
        return joined(self._namespace, topic)

    def _endpoint(self, topic: str, kind: str) -> Endpoint:
        return Endpoint(self._domain, self.name_of(topic), kind)

    def publisher(self, topic: str, kind: str, *, latched: bool = False) -> RosPublisher:
        """A publisher on a topic within the namespace. latched: who subscribes later gets the last message."""
        endpoint, quality = self._endpoint(topic, kind), Quality(latched=latched, depth=1 if latched else 10)
        made: Any
        if latched:
            keeps = zenoh.ext.CacheConfig(1)
            made = zenoh.ext.declare_advanced_publisher(
                self._session, endpoint.key, cache=keeps, publisher_detection=True
            )
        else:
            made = self._session.declare_publisher(endpoint.key, express=True)
        self._declared.enter_context(made)
        return RosPublisher(endpoint, made, self._tell(PUBLISHER, f"{endpoint.words}/{quality}"))

    def subscribe(self, topic: str, kind: str, hear: Callable[[bytes, bytes], None], *, reliable: bool = True) -> None:
        """Hear a topic: `hear` is called with each payload and attachment, on Zenoh's thread; it must only queue."""
        endpoint = self._endpoint(topic, kind)

        def take(sample: zenoh.Sample) -> None:
            hear(sample.payload.to_bytes(), b"" if sample.attachment is None else sample.attachment.to_bytes())

        self._declared.enter_context(self._session.declare_subscriber(endpoint.key, at_once(take)))
        self._tell(SUBSCRIBER, f"{endpoint.words}/{Quality(reliable=reliable)}")

    def watch_subscribers(self, topic: str, hear: Callable[[str, str, bool], None]) -> None:
        """Be told who subscribes to a topic: `hear` is called with token, type, and whether it came or went."""

        def take(sample: zenoh.Sample) -> None:
            told = str(sample.key_expr)
            hear(told, kind_in(told), sample.kind == zenoh.SampleKind.PUT)

        tokens = tokens_of(self._domain, SUBSCRIBER, self.name_of(topic))
        watch = self._session.liveliness().declare_subscriber(tokens, take, history=True)
        self._declared.enter_context(watch)
