"""Wire format of rmw_zenoh, as of ROS 2 Jazzy and newer: keys, tokens, attachments. Pure.

Sources: `liveliness_utils.cpp` and `attachment_helpers.cpp` of ros2/rmw_zenoh.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import StrEnum

import xxhash

from tsd_twin.errors import MessageError
from tsd_twin.interop.mapping import RosQoS

_ATTACHMENT = struct.Struct("<qqB16s")
_GID_BYTES = 16

QOS = {
    RosQoS.SENSOR: "2::,5:,:,:,,",
    RosQoS.STATE: "::,10:,:,:,,",
    RosQoS.LATCHED: ":1:,1:,:,:,,",
    RosQoS.COMMAND: "2::,1:,:,:,,",
}
"""QoS in a token: reliability, durability, history, depth, deadline, lifespan, liveliness.

Fields are numbers of `rmw/types.h`; a default (reliable, volatile, keep last) is empty.
"""
SERVICE_QOS = "::,10:,:,:,,"


class Kind(StrEnum):
    """Kind of an entity in a token."""

    PUBLISHER = "MP"
    SUBSCRIPTION = "MS"
    SERVICE = "SS"


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
