"""Velocity commands: a twist, with lease and sequence numbers as an attachment."""

from __future__ import annotations

import functools
import struct
from dataclasses import dataclass

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.messages.cdr import BASE, ODOM, TwistStamped, decode_twist
from tsd_twin.messages.codes import Code, Reason, because, text_reason
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.events import Event
from tsd_twin.messages.services import LeaseReply, Reply
from tsd_twin.messages.signatures import ATTACHMENT_BYTES, TAG_BYTES
from tsd_twin.messages.topics import Sample

_ATTACHMENT = struct.Struct("<Q16sQ")
_PAYLOADS_KEPT = 16


@dataclass(frozen=True, slots=True, eq=False)
class Command:
    """Decoded velocity command, before validation by the command gate."""

    operator: str
    seq: int
    lease: bytes
    status_seq: int
    """Latest received status number; bounds the age without synchronized clocks."""
    frame: str
    """`base_link` or `odom`."""
    twist: Array
    """(6,): spatial twist, finite."""


def encode_attachment(seq: int, lease: bytes, status_seq: int) -> bytes:
    """Encode a command attachment: sequence number, lease and latest received status."""
    return _ATTACHMENT.pack(seq, lease, status_seq)


def decode_command(sample: Sample) -> Command:
    """Decode a sample of `twin/<robot>/cmd/<operator>/twist`.

    Raises:
        MessageError: With reason `key`, `shape` or `nonfinite`.
    """
    parts = sample.key.split("/")
    if not sample.is_put or len(parts) != 5 or "*" in sample.key:
        raise MessageError("key", because(Code.BAD_KEY, key=sample.key))
    try:
        # A robot without a list of operators ignores the tag of a signed command.
        signed = len(sample.attachment) == ATTACHMENT_BYTES + TAG_BYTES
        attachment = sample.attachment[:ATTACHMENT_BYTES] if signed else sample.attachment
        seq, lease, status_seq = _ATTACHMENT.unpack(attachment)
    except struct.error as error:
        raise MessageError("shape", f"attachment: {error}") from error
    message = _checked_twist(sample.payload)
    return Command(parts[3], seq, lease, status_seq, message.frame, message.twist)


@functools.lru_cache(maxsize=_PAYLOADS_KEPT)
def _checked_twist(payload: bytes) -> TwistStamped:
    """Decode an immutable twist; cached because motions repeat it at 50 Hz."""
    message = decode_twist(payload)
    if message.frame not in (BASE, ODOM):
        raise MessageError("shape", f"frame_id must be {BASE} or {ODOM}")
    if not np.isfinite(message.twist).all():
        raise MessageError("nonfinite", because(Code.NOT_FINITE, quantity="twist"))
    message.twist.setflags(write=False)
    return message


def why_of(message: Reply | LeaseReply | Event) -> Reason | None:
    """Reason in a message; a robot without codes sends only its text."""
    return message.why or text_reason(
        message.text if isinstance(message, Event) else message.reason
    )
