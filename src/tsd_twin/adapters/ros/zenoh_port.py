"""ROS nodes over the rmw_zenoh protocol (keys, tokens, attachments), one session per robot.

Format as in ROS 2 Jazzy and newer: `liveliness_utils.cpp` and `attachment_helpers.cpp` of
ros2/rmw_zenoh.
"""

from __future__ import annotations

import itertools
import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial

import xxhash

from tsd_twin.adapters.ros.arrivals import Origin
from tsd_twin.adapters.ros.port import ADAPTER, Endpoints, PortCallbacks, types_of
from tsd_twin.adapters.ros_messages import RosMessage
from tsd_twin.adapters.ros_topics import CMD_VEL, ODOMETRY, RosNames, RosQoS, RosTopic
from tsd_twin.bus import Bus, PendingQuery, Publisher
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.ros_types import TRIGGER, encode_trigger_response, type_hash
from tsd_twin.messages.topics import QoS, Sample

_ATTACHMENT = struct.Struct("<qqB16s")
_GID_BYTES = 16
_MOST_ENDPOINTS = 1000
"""Maximum number of recorded external endpoints per topic; two are already a fault."""

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
"""Zenoh QoS of publishers that differ from `QoS.DATA`."""
SERVICE_QOS = "::,10:,:,:,,"


class Kind(StrEnum):
    """Entity kind in a token."""

    PUBLISHER = "MP"
    SUBSCRIPTION = "MS"
    SERVICE = "SS"


def endpoints_key(domain: int, kind: Kind, name: str) -> str:
    """Return the key expression for tokens of all endpoints of a kind on a topic."""
    return f"@ros2_lv/{domain}/*/*/*/{kind}/*/*/*/{_mangled(name)}/**"


def node_of(token: str) -> tuple[str, str]:
    """Return session and node name in an endpoint token."""
    parts = token.split("/")
    return parts[2], parts[8]


def dds_type(type_name: str) -> str:
    """Return the DDS name of a type, such as `std_msgs::msg::dds_::String_`."""
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def topic_key(domain: int, name: str, type_name: str, type_hash: str) -> str:
    """Return the key of a topic or service."""
    return f"{domain}/{name.strip('/')}/{dds_type(type_name)}/{type_hash}"


@dataclass(frozen=True, slots=True)
class RosNode:
    """Node in the ROS graph; one per Zenoh session."""

    domain: int
    session: str
    """Zenoh session id."""
    name: str
    namespace: str = "/"

    def token(self) -> str:
        """Return the key of the node's liveliness token."""
        return self._token(0, "NN")

    def endpoint_token(
        self, number: int, kind: Kind, name: str, type_name: str, type_hash: str, qos: str
    ) -> str:
        """Return the token key of a topic or service; `number` is unique in this session."""
        mine = self._token(number, kind)
        return f"{mine}/{_mangled(name)}/{dds_type(type_name)}/{type_hash}/{qos}"

    def _token(self, number: int, kind: str) -> str:
        # SROS 2 enclaves are not used; the default is `/`.
        place = f"@ros2_lv/{self.domain}/{self.session}/0/{number}/{kind}"
        return f"{place}/%/{_mangled(self.namespace)}/{self.name}"


def _mangled(name: str) -> str:
    return name.replace("/", "%")


def gid_of(token: str) -> bytes:
    """Return the endpoint id: XXH3-128 of its token, low half first, little-endian."""
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")


def encode_attachment(origin: Origin) -> bytes:
    """Encode the attachment of a message, request or response in 33 bytes."""
    return _ATTACHMENT.pack(origin.sequence, origin.source_ns, _GID_BYTES, origin.publisher)


def decode_attachment(data: bytes) -> Origin:
    """Decode an attachment.

    Raises:
        MessageError: If the attachment is invalid (`shape`).
    """
    if len(data) != _ATTACHMENT.size or data[16] != _GID_BYTES:
        raise MessageError("shape", "no attachment of rmw_zenoh (ROS 2 Jazzy or newer) is there")
    sequence, source_ns, _, gid = _ATTACHMENT.unpack(data)
    return Origin(gid, sequence, source_ns)


class ZenohPort:
    """Node for a robot on a dedicated session, which it closes."""

    def __init__(
        self,
        bus: Bus,
        domain: int,
        names: RosNames,
        inputs: PortCallbacks | None,
        endpoints: Endpoints = ADAPTER,
    ) -> None:
        """Without `inputs`, subscribe to nothing and offer no services."""
        self._bus, self._domain, self._names = bus, domain, names
        namespace = f"/{names.namespace}" if names.shared else "/"
        self._node = RosNode(domain, bus.id, endpoints.node, namespace)
        self._numbers = itertools.count(1)
        self._published: dict[str, tuple[Publisher, bytes, Iterator[int]]] = {}
        """Publisher, endpoint id and sequence numbers of each topic."""
        bus.declare_token(self._node.token())
        for row in endpoints.published:
            name = names.topic(row.name)
            qos = _ON_BUS.get(row.qos, QoS.DATA)
            # Transient local needs an advanced publisher with a cache of the QoS depth, here 1.
            publisher = bus.publisher(self._key(name, row.type), qos, row.type, kept=1)
            gid = self._enter(Kind.PUBLISHER, name, row.type, QOS[row.qos])
            self._published[name] = publisher, gid, itertools.count(1)
        self._others: dict[tuple[Kind, str], dict[str, str]] = {}
        if inputs is not None:
            self._listen(inputs, endpoints)

    def _listen(self, inputs: PortCallbacks, endpoints: Endpoints) -> None:
        bus, names = self._bus, self._names
        for kind, row in ((Kind.PUBLISHER, ODOMETRY), (Kind.SUBSCRIPTION, CMD_VEL)):
            name = names.topic(row.name)
            found = self._others.setdefault((kind, name), {})
            key = endpoints_key(self._domain, kind, name)
            bus.subscribe_liveliness(key, partial(self._note_endpoint, found))
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
        return self._published[topic][0].has_subscribers

    def publish(self, message: RosMessage) -> None:
        """Publish a message."""
        publisher, gid, numbers = self._published[message.name]
        attachment = encode_attachment(Origin(gid, next(numbers), time.time_ns()))
        publisher.put(message.payload, attachment)

    def publishers(self, topic: str) -> list[str]:
        """Return the names of other nodes publishing `odom`."""
        return list(self._others.get((Kind.PUBLISHER, topic), {}).values())

    def subscribers(self, topic: str) -> list[str]:
        """Return the names of other nodes reading `cmd_vel`."""
        return list(self._others.get((Kind.SUBSCRIPTION, topic), {}).values())

    def _note_endpoint(self, found: dict[str, str], token: str, lives: bool) -> None:
        session, node = node_of(token)
        if not lives:
            found.pop(token, None)
        elif session != self._node.session and len(found) < _MOST_ENDPOINTS:
            found[token] = node

    def close(self) -> None:
        """Leave the graph; closing the session ends publishers, tokens and services."""
        self._bus.close()

    def _key(self, name: str, type_name: str) -> str:
        return topic_key(self._domain, name, type_name, type_hash(type_name))

    def _enter(self, kind: Kind, name: str, type_name: str, qos: str) -> bytes:
        """Declare an endpoint token and return its id."""
        number = next(self._numbers)
        token = self._node.endpoint_token(number, kind, name, type_name, type_hash(type_name), qos)
        self._bus.declare_token(token)
        return gid_of(token)


def _receive(inputs: PortCallbacks, row: RosTopic, type_name: str, sample: Sample) -> None:
    if not sample.is_put:
        return
    try:
        origin = decode_attachment(sample.attachment)
    except MessageError as error:
        inputs.on_unreadable(row.name, str(error))
        return
    inputs.on_message(row, type_name, sample.payload, origin)


def _serve(inputs: PortCallbacks, service: str, request: PendingQuery) -> None:
    try:
        asked = decode_attachment(request.attachment)
    except MessageError as error:
        inputs.on_unreadable(service, str(error))
        request.drop()
        return

    def answer(success: bool, text: str) -> None:
        # Clients match responses by the sequence number and id of the request.
        attachment = encode_attachment(replace(asked, source_ns=time.time_ns()))
        request.reply(encode_trigger_response(success, text), attachment)

    inputs.on_call(service, answer)
