"""ROS nodes over the protocol of rmw_zenoh: keys, tokens, attachments, a session for each robot.

Sources of the format, as of ROS 2 Jazzy and newer: `liveliness_utils.cpp` and
`attachment_helpers.cpp` of ros2/rmw_zenoh.
"""

from __future__ import annotations

import itertools
import struct
import time
from dataclasses import dataclass
from enum import StrEnum
from functools import partial

import xxhash

from tsd_twin.bus import Bus, Publisher, Request
from tsd_twin.errors import MessageError
from tsd_twin.interop.mapping import (
    CMD_VEL,
    ODOMETRY,
    RosMessage,
    RosNames,
    RosQoS,
    RosTopic,
)
from tsd_twin.messages.requests import Sample
from tsd_twin.messages.ros_types import TRIGGER, encode_trigger_response, type_hash
from tsd_twin.messages.topics import QoS
from tsd_twin.ros.arrivals import Origin
from tsd_twin.ros.port import ADAPTER, Endpoints, Inputs, types_of

_ATTACHMENT = struct.Struct("<qqB16s")
_GID_BYTES = 16
_MOST_ENDPOINTS = 1000
"""Endpoints of others on one topic that are noted; two are a fault already."""

QOS = {
    RosQoS.SENSOR: "2::,5:,:,:,,",
    RosQoS.STATE: "::,10:,:,:,,",
    RosQoS.LATCHED: ":1:,1:,:,:,,",
    RosQoS.COMMAND: "2::,1:,:,:,,",
    RosQoS.DRIVE: "::,1:,:,:,,",
}
"""QoS in a token: reliability, durability, history, depth, deadline, lifespan, liveliness.

Fields are numbers of `rmw/types.h`; a default (reliable, volatile, keep last) is empty.
"""
_ON_BUS = {RosQoS.LATCHED: QoS.EVENT, RosQoS.DRIVE: QoS.REAL_TIME}
"""Quality of service of a publisher in Zenoh, where it is not that of data."""
SERVICE_QOS = "::,10:,:,:,,"


class Kind(StrEnum):
    """Kind of an entity in a token."""

    PUBLISHER = "MP"
    SUBSCRIPTION = "MS"
    SERVICE = "SS"


def endpoints_key(domain: int, kind: Kind, name: str) -> str:
    """Return the key of the tokens of all endpoints of a kind on a topic."""
    return f"@ros2_lv/{domain}/*/*/*/{kind}/*/*/*/{_mangled(name)}/**"


def node_of(token: str) -> tuple[str, str]:
    """Return session and node of the token of an endpoint."""
    parts = token.split("/")
    return parts[2], parts[8]


def dds_type(type_name: str) -> str:
    """Return the name in DDS of a type: `std_msgs::msg::dds_::String_`."""
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def topic_key(domain: int, name: str, type_name: str, type_hash: str) -> str:
    """Return the key of a topic or a service."""
    return f"{domain}/{name.strip('/')}/{dds_type(type_name)}/{type_hash}"


@dataclass(frozen=True, slots=True)
class RosNode:
    """A node in the graph: one Zenoh session has one here."""

    domain: int
    session: str
    """Id of its Zenoh session."""
    name: str
    namespace: str = "/"

    def token(self) -> str:
        """Return the key of its liveliness token."""
        return self._token(0, "NN")

    def endpoint_token(
        self, number: int, kind: Kind, name: str, type_name: str, type_hash: str, qos: str
    ) -> str:
        """Return the key of the token of a topic or service; `number` is one of this session."""
        mine = self._token(number, kind)
        return f"{mine}/{_mangled(name)}/{dds_type(type_name)}/{type_hash}/{qos}"

    def _token(self, number: int, kind: str) -> str:
        # Enclaves of SROS 2 are not used: the default is `/`.
        place = f"@ros2_lv/{self.domain}/{self.session}/0/{number}/{kind}"
        return f"{place}/%/{_mangled(self.namespace)}/{self.name}"


def _mangled(name: str) -> str:
    return name.replace("/", "%")


def gid_of(token: str) -> bytes:
    """Return the id of an endpoint: XXH3-128 of its token, lower half first, little-endian."""
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")


@dataclass(frozen=True, slots=True)
class Attachment:
    """Attachment of a message, a request, or a response."""

    sequence: int
    source_ns: int
    """Wall clock of the sender."""
    gid: bytes

    def encode(self) -> bytes:
        """Return the 33 bytes."""
        return _ATTACHMENT.pack(self.sequence, self.source_ns, _GID_BYTES, self.gid)


def decode_attachment(data: bytes) -> Attachment:
    """Read an attachment.

    Raises:
        MessageError: `shape`, when it is none.
    """
    if len(data) != _ATTACHMENT.size or data[16] != _GID_BYTES:
        raise MessageError("shape", "no attachment of rmw_zenoh (ROS 2 Jazzy or newer) is there")
    sequence, source_ns, _, gid = _ATTACHMENT.unpack(data)
    return Attachment(sequence, source_ns, gid)


@dataclass(slots=True)
class _Published:
    publisher: Publisher
    gid: bytes
    sequence: int = 0


class ZenohPort:
    """Node of one robot on a session of its own, which it closes."""

    def __init__(
        self,
        bus: Bus,
        domain: int,
        names: RosNames,
        inputs: Inputs | None,
        endpoints: Endpoints = ADAPTER,
    ) -> None:
        """Without `inputs`, nothing is read and no service is offered."""
        self._bus, self._domain, self._names = bus, domain, names
        namespace = f"/{names.namespace}" if names.shared else "/"
        self._node = RosNode(domain, bus.id, endpoints.node, namespace)
        self._numbers = itertools.count(1)
        self._published: dict[str, _Published] = {}
        bus.declare_token(self._node.token())
        for row in endpoints.published:
            name = names.topic(row.name)
            qos = _ON_BUS.get(row.qos, QoS.DATA)
            # Transient local is an advanced publisher with a cache of the depth, here one.
            publisher = bus.publisher(self._key(name, row.type), qos, row.type, kept=1)
            gid = self._enter(Kind.PUBLISHER, name, row.type, QOS[row.qos])
            self._published[name] = _Published(publisher, gid)
        self._others: dict[tuple[Kind, str], dict[str, str]] = {}
        if inputs is None:
            return
        for kind, row in ((Kind.PUBLISHER, ODOMETRY), (Kind.SUBSCRIPTION, CMD_VEL)):
            name = names.topic(row.name)
            found = self._others.setdefault((kind, name), {})
            bus.subscribe_liveliness(
                endpoints_key(domain, kind, name), partial(self._note_endpoint, found)
            )
        for row in endpoints.read:
            name = names.topic(row.name)
            for type_name in types_of(row):
                take = partial(_receive, inputs, row, type_name)
                listen = bus.subscribe_events if row.qos is RosQoS.LATCHED else bus.subscribe
                listen(self._key(name, type_name), take)
                self._enter(Kind.SUBSCRIPTION, name, type_name, QOS[row.qos])
        for service in endpoints.services:
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

    def publishers(self, topic: str) -> list[str]:
        """Return the names of the other nodes that publish `odom`."""
        return list(self._others.get((Kind.PUBLISHER, topic), {}).values())

    def subscribers(self, topic: str) -> list[str]:
        """Return the names of the other nodes that read `cmd_vel`."""
        return list(self._others.get((Kind.SUBSCRIPTION, topic), {}).values())

    def _note_endpoint(self, found: dict[str, str], token: str, lives: bool) -> None:
        session, node = node_of(token)
        if not lives:
            found.pop(token, None)
        elif session != self._node.session and len(found) < _MOST_ENDPOINTS:
            found[token] = node

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
        inputs.on_unreadable(row.name, str(error))
        return
    origin = Origin(read.gid, read.sequence, read.source_ns)
    inputs.on_message(row, type_name, sample.payload, origin)


def _serve(inputs: Inputs, service: str, request: Request) -> None:
    try:
        asked = decode_attachment(request.attachment)
    except MessageError as error:
        inputs.on_unreadable(service, str(error))
        request.drop()
        return

    def answer(success: bool, text: str) -> None:
        # Sequence and id are those of the request: so the client finds its answer.
        attachment = Attachment(asked.sequence, time.time_ns(), asked.gid)
        request.reply(encode_trigger_response(success, text), attachment.encode())

    inputs.on_call(service, answer)
