"""Redaction of lease ids: each id becomes another, the same one at all places."""

from __future__ import annotations

import hashlib
import re
import secrets
from collections.abc import Sequence

import msgspec

from tsd_twin.errors import MessageError
from tsd_twin.messages import topics
from tsd_twin.messages.commands import Sample
from tsd_twin.messages.input_log import (
    Call,
    InputBatch,
    LeaseDrawn,
    PosesCall,
    ServeCall,
    Snapshot,
    StepCall,
    StopCall,
    decode_batch,
    encode_batch,
)
from tsd_twin.messages.topics import Service
from tsd_twin.recording.channels import JSON, RAW, Entry, RawMessage, topic_of

_HEX_ID = re.compile(rb"[0-9a-f]{32}")
_LEASE = slice(8, 24)
"""Place of the lease id in the attachment of a command, which has 32 bytes."""
_ATTACHMENT_BYTES = 32


class Redactor:
    """Replaces lease ids; a run can still be repeated, since ids are only compared.

    The replacement depends on a secret that is forgotten, so no id can be found again.
    """

    def __init__(self) -> None:
        self._key = secrets.token_bytes(32)

    def entry(self, entry: Entry) -> Entry:
        """Return an entry without lease ids."""
        topic = topic_of(entry.topic)
        if topic is topics.INPUTS:
            try:
                return entry._replace(data=self._batch(entry.data))
            except MessageError:
                return entry._replace(data=b"")
        if entry.topic.endswith(RAW):
            return entry._replace(data=self._raw(entry.data))
        if entry.encoding == JSON and not entry.topic.endswith(f"/{Service.DESC}"):
            return entry._replace(data=self.text(entry.data))
        return entry

    def id(self, lease: bytes) -> bytes:
        """Return the replacement of an id."""
        return hashlib.blake2b(lease, key=self._key, digest_size=16).digest()

    def text(self, data: bytes) -> bytes:
        """Return JSON with all ids in it replaced."""
        return _HEX_ID.sub(
            lambda found: self.id(bytes.fromhex(found[0].decode())).hex().encode(), data
        )

    def attachment(self, attachment: bytes) -> bytes:
        """Return the attachment of a command with its id replaced; any other is blotted out."""
        if len(attachment) != _ATTACHMENT_BYTES:
            return bytes(len(attachment))
        changed = bytearray(attachment)
        changed[_LEASE] = self.id(attachment[_LEASE])
        return bytes(changed)

    def _raw(self, data: bytes) -> bytes:
        raw = msgspec.json.decode(data, type=RawMessage)
        attachment = self.attachment(bytes.fromhex(raw.attachment)).hex()
        # What could not be read may have anything in it.
        payload = None if raw.payload is None else ""
        return msgspec.json.encode(RawMessage(attachment, payload, raw.put))

    def _batch(self, data: bytes) -> bytes:
        batch = decode_batch(data)
        snapshot = batch.snapshot
        if snapshot is not None:
            state = snapshot.state
            for lease in snapshot.leases:
                state = state.replace(lease, self.id(lease))
            snapshot = Snapshot(snapshot.build, state, [self.id(each) for each in snapshot.leases])
        calls = [self._call(call) for call in batch.calls]
        return encode_batch(InputBatch(batch.first, calls, snapshot, batch.pose))

    def _call(self, call: Call) -> Call:
        replace = msgspec.structs.replace
        match call:
            case LeaseDrawn():
                return LeaseDrawn(self.id(call.id))
            case ServeCall() | StopCall():
                return replace(call, payload=self.text(call.payload), reply=self.text(call.reply))
            case StepCall():
                return replace(call, samples=self._samples(call.samples))
            case PosesCall():
                return replace(call, poses=self._samples(call.poses))
            case _:
                return call

    def _samples(self, samples: Sequence[Sample]) -> list[Sample]:
        return [
            Sample(each.key, each.payload, self.attachment(each.attachment), each.is_put)
            for each in samples
        ]
