"""Services of ROS 2, as clients and servers whose ROS 2 runs on Cyclone DDS have them on the wire."""

from __future__ import annotations

import functools
import logging
import secrets
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from anm_mj.ros.node import Node, Publisher

_CALLER = "uint64 client\nint64 number\n"
"""What precedes request and reply."""
_CALLER_KIND = "anm_mj/msg/Caller"
_CALLER_END = 20
"""Bytes of a serialised message until then."""

_logger = logging.getLogger(__name__)

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
        most = None if kind.reply_bytes is None else _CALLER_END + kind.reply_bytes
        node.raw_subscribe(
            f"rr{node.name(service)}Reply", reply, self._hear, lambda data: node.parse(reply, data[:most])
        )

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
    """Offer a service. ``called`` gets each request, and what sends the reply, at once or later."""
    request_kind, reply_kind = kind.register(node.messages.store)
    answers = _answers(node, service, reply_kind)
    node.raw_subscribe(
        f"rq{node.name(service)}Request", request_kind, lambda request, _: called(request, answers(request))
    )


def serve_trigger(node: Node, service: str, called: Callable[[], tuple[bool, str]]) -> None:
    """Offer a service ``std_srvs/srv/Trigger``; ``called`` gives success and message of the reply. Callers whose ROS 2
    does not run on Cyclone DDS are obeyed, and get no reply: their requests do not name them.
    """
    store, request_kind = node.messages.store, f"{TRIGGER.name}_Request"
    # Cyclone DDS keeps back what is shorter than its type.
    register_type(store, request_kind, TRIGGER.request)
    register_type(store, _CALLER_KIND, _CALLER)
    register_type(store, f"{TRIGGER.name}_Response", _CALLER + TRIGGER.reply)
    answers = _answers(node, service, f"{TRIGGER.name}_Response")

    def heard(caller: Any, _: int) -> None:
        success, message = called()
        if caller is not None:
            answers(caller)(success=success, message=message)
        else:
            _logger.warning("%s: its caller's ROS 2 does not run on Cyclone DDS and gets no reply.", node.name(service))

    def parse(data: bytes) -> Any:
        return None if len(data) <= _CALLER_END else node.parse(_CALLER_KIND, data[:_CALLER_END])

    node.raw_subscribe(f"rq{node.name(service)}Request", request_kind, heard, parse)


def _answers(node: Node, service: str, reply_kind: str) -> Callable[[Any], Answer]:
    """Gives what sends the reply to a caller."""
    replies = node.raw_publisher(f"rr{node.name(service)}Reply", reply_kind)

    def to(caller: Any) -> Answer:
        make = functools.partial(node.messages.make, reply_kind, client=caller.client, number=caller.number)
        return lambda **fields: replies.publish(make(**fields))

    return to
