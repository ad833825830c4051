"""A command as it arrives from the bus."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from tsd_twin.errors import MessageError
from tsd_twin.lie import Array
from tsd_twin.messages.ros import BASE, ODOM, decode_twist

_ATTACHMENT = struct.Struct("<Q16sQ")


@dataclass(frozen=True, slots=True)
class Sample:
    """What the bus hands over: nothing in it has been checked."""

    key: str
    payload: bytes
    attachment: bytes
    is_put: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Command:
    """A readable command; whether it counts is for the authority to say."""

    operator: str
    seq: int
    lease: bytes
    status_seq: int
    """Newest `state/status` that the operator had seen: bounds the age without a common clock."""
    frame: str
    """`base_link` or `odom`."""
    twist: Array
    """(6,): spatial, finite."""


def encode_attachment(seq: int, lease: bytes, status_seq: int) -> bytes:
    """Return the attachment of a command: its number, its lease, the newest status seen."""
    return _ATTACHMENT.pack(seq, lease, status_seq)


def decode_command(sample: Sample) -> Command:
    """Return the command in a sample of `twin/<robot>/cmd/<operator>/twist`.

    Raises:
        MessageError: the reason is one of `key`, `shape` and `nonfinite`.
    """
    parts = sample.key.split("/")
    if not sample.is_put or len(parts) != 5 or "*" in sample.key:
        raise MessageError("key", f"{sample.key} is not the key of one operator")
    try:
        seq, lease, status_seq = _ATTACHMENT.unpack(sample.attachment)
    except struct.error as error:
        raise MessageError("shape", f"attachment: {error}") from error
    message = decode_twist(sample.payload)
    if message.frame not in (BASE, ODOM):
        raise MessageError("shape", f"frame_id must be {BASE} or {ODOM}")
    if not np.isfinite(message.twist).all():
        raise MessageError("nonfinite", "a twist must be finite numbers")
    return Command(parts[3], seq, lease, status_seq, message.frame, message.twist)
