"""ROS nodes over the protocol of rmw_zenoh: each robot has a session, and so a node, of its own."""

from __future__ import annotations

import itertools
import logging
import time
from dataclasses import dataclass
from functools import partial

from tsd_twin.bus import Bus, Publisher, Request
from tsd_twin.errors import MessageError
from tsd_twin.interop.mapping import (
    LATCHED_TOPICS,
    PUBLISHED,
    READ,
    SERVICES,
    RosMessage,
    RosNames,
    RosTopic,
)
from tsd_twin.messages.requests import Sample
from tsd_twin.messages.ros import TRIGGER, encode_trigger_response, type_hash
from tsd_twin.messages.topics import QoS
from tsd_twin.ros.inputs import Origin
from tsd_twin.ros.port import NODE, Inputs, types_of
from tsd_twin.ros.wire import (
    QOS,
    SERVICE_QOS,
    Attachment,
    Kind,
    RosNode,
    decode_attachment,
    gid_of,
    topic_key,
)

_LOG = logging.getLogger(__name__)


@dataclass(slots=True)
class _Published:
    publisher: Publisher
    gid: bytes
    sequence: int = 0


class ZenohPort:
    """Node of one robot on a session of its own, which it closes."""

    def __init__(self, bus: Bus, domain: int, names: RosNames, inputs: Inputs | None) -> None:
        """Without `inputs`, nothing is read and no service is offered."""
        self._bus, self._domain, self._names = bus, domain, names
        namespace = f"/{names.namespace}" if names.shared else "/"
        self._node = RosNode(domain, bus.id, NODE, namespace)
        self._numbers = itertools.count(1)
        self._published: dict[str, _Published] = {}
        bus.declare_token(self._node.token())
        for row in PUBLISHED:
            name = names.topic(row.name)
            qos = QoS.EVENT if row in LATCHED_TOPICS else QoS.DATA
            # Transient local is an advanced publisher with a cache of the depth, here one.
            publisher = bus.publisher(self._key(name, row.type), qos, row.type, kept=1)
            gid = self._enter(Kind.PUBLISHER, name, row.type, QOS[row.qos])
            self._published[name] = _Published(publisher, gid)
        if inputs is None:
            return
        for row in READ:
            name = names.topic(row.name)
            for type_name in types_of(row):
                take = partial(_receive, inputs, row, type_name)
                bus.subscribe(self._key(name, type_name), take)
                self._enter(Kind.SUBSCRIPTION, name, type_name, QOS[row.qos])
        for service in SERVICES:
            name = names.topic(service)
            bus.serve(self._key(name, TRIGGER), partial(_serve, inputs, service))
            self._enter(Kind.SERVICE, name, TRIGGER, SERVICE_QOS)

    def wants(self, topic: str) -> bool:
        """Return whether a topic has a subscriber."""
        return self._published[topic].publisher.has_subscribers

    def publish(self, message: RosMessage) -> None:
        """Publish a message."""
        to = self._published[message.name]
        to.sequence += 1
        to.publisher.put(message.payload, Attachment(to.sequence, time.time_ns(), to.gid).encode())

    def close(self) -> None:
        """Leave the graph: publishers, tokens and services end with the session."""
        self._bus.close()

    def _key(self, name: str, type_name: str) -> str:
        return topic_key(self._domain, name, type_name, type_hash(type_name))

    def _enter(self, kind: Kind, name: str, type_name: str, qos: str) -> bytes:
        """Declare the token of an endpoint, and return its id."""
        number = next(self._numbers)
        token = self._node.endpoint_token(number, kind, name, type_name, type_hash(type_name), qos)
        self._bus.declare_token(token)
        return gid_of(token)


def _receive(inputs: Inputs, row: RosTopic, type_name: str, sample: Sample) -> None:
    if not sample.is_put:
        return
    try:
        read = decode_attachment(sample.attachment)
    except MessageError as error:
        inputs.on_unreadable(row, str(error))
        return
    origin = Origin(read.gid, read.sequence, read.source_ns)
    inputs.on_message(row, type_name, sample.payload, origin)


def _serve(inputs: Inputs, service: str, request: Request) -> None:
    try:
        asked = decode_attachment(request.attachment)
    except MessageError as error:
        _LOG.warning("a call of %s is ignored: %s", service, error)
        request.drop()
        return

    def answer(success: bool, text: str) -> None:
        # Sequence and id are those of the request: so the client finds its answer.
        attachment = Attachment(asked.sequence, time.time_ns(), asked.gid)
        request.reply(encode_trigger_response(success, text), attachment.encode())

    inputs.on_call(service, answer)
