"""Services of ROS 2, as clients and servers whose ROS 2 runs on Cyclone DDS have them on the wire."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from anm_mj.ros.node import Node, Publisher

_CALLER = "uint64 client\nint64 number\n"
"""What precedes request and reply."""

Answer = Callable[..., None]
"""Sends a reply; its fields are the arguments."""


class ServiceKind(NamedTuple):
    """The type of a service."""

    name: str
    """Such as ``std_srvs/srv/Trigger``."""
    request: str
    """Its definition."""
    reply: str
    """Its definition, or the beginning of it that is the same in all distributions."""
    reply_bytes: int | None = None
    """The size of that beginning, where there is more of it."""

    def register(self, store: Any) -> tuple[str, str]:
        """The names of the types of request and reply, which the store knows then."""
        # DDS calls the type of a reply a response.
        kinds = f"{self.name}_Request", f"{self.name}_Response"
        for kind, fields in zip(kinds, (self.request, self.reply), strict=True):
            register_type(store, kind, _CALLER + fields)
        return kinds


def register_type(store: Any, kind: str, fields: str) -> None:
    """Let a store know a type by its definition."""
    from rosbags.typesys import get_types_from_msg

    if kind not in store.types:
        (found,) = get_types_from_msg(fields, kind).values()
        store.register({kind: found})


TRIGGER = ServiceKind("std_srvs/srv/Trigger", "uint8 unused\n", "bool success\nstring message\n")


class Client:
    """Calls a service, one request after another."""

    def __init__(self, node: Node, service: str, kind: ServiceKind) -> None:
        """Look for the service."""
        self._node, self._kind = node, kind
        self._request, reply = kind.register(node.messages.store)
        self._requests: Publisher = node.raw_publisher(f"rq{node.name(service)}Request", self._request)
        self._client, self._number = secrets.randbits(63), 0
        self._waiting: dict[int, Callable[[Any], object]] = {}
        most = None if kind.reply_bytes is None else 20 + kind.reply_bytes
        node.raw_subscribe(f"rr{node.name(service)}Reply", reply, self._hear, most)

    @property
    def is_there(self) -> bool:
        """Whether somebody offers the service."""
        return self._requests.num_subscribers > 0

    def call(self, heard: Callable[[Any], object], **fields: Any) -> None:
        """Send a request; ``heard`` is called with the reply, in another thread."""
        self._number += 1
        self._waiting[self._number] = heard
        message = self._node.messages.make(self._request, client=self._client, number=self._number, **fields)
        self._requests.publish(message)

    def _hear(self, reply: Any, _: int) -> None:
        if reply.client == self._client and reply.number in self._waiting:
            self._waiting.pop(reply.number)(reply)


def serve(node: Node, service: str, kind: ServiceKind, called: Callable[[Any, Answer], object]) -> None:
    """Offer a service.

    Args:
        node: hears and speaks.
        service: its name.
        kind: its type.
        called: gets each request, and what sends the reply, at once or later.
    """
    request_kind, reply_kind = kind.register(node.messages.store)
    replies = node.raw_publisher(f"rr{node.name(service)}Reply", reply_kind)

    def heard(request: Any, _: int) -> None:
        def answer(**fields: Any) -> None:
            replies.publish(node.messages.make(reply_kind, client=request.client, number=request.number, **fields))

        called(request, answer)

    node.raw_subscribe(f"rq{node.name(service)}Request", request_kind, heard)


def serve_trigger(node: Node, service: str, called: Callable[[], tuple[bool, str]]) -> None:
    """Offer a service ``std_srvs/srv/Trigger``; ``called`` gives success and message of the reply."""

    def heard(_: Any, answer: Answer) -> None:
        success, message = called()
        answer(success=success, message=message)

    serve(node, service, TRIGGER, heard)
