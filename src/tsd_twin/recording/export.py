"""Export of recordings: a time range as MCAP with lease ids replaced, or each stream as CSV."""

from __future__ import annotations

import csv
import hashlib
import os
import re
import secrets
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from msgspec.structs import replace

from tsd_twin.control.logged_controller import (
    Call,
    LeaseDrawn,
    PosesCall,
    ServeCall,
    StepCall,
    StopCall,
    decode_batch,
    encode_batch,
)
from tsd_twin.errors import TwinError
from tsd_twin.messages import topics
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.topics import Sample, Service
from tsd_twin.recording import mcap_file
from tsd_twin.recording.channels import JSON, MSGPACK, RAW, Entry, RawMessage, robot_of, topic_of
from tsd_twin.recording.data import Recording, open_recording
from tsd_twin.recording.events import add_mark, read_marks
from tsd_twin.recording.mcap_file import McapWriter


@dataclass(frozen=True, slots=True)
class RecordingSlice:
    """Time range of a recording; seconds since its start."""

    path: Path
    start_s: float = 0.0
    end_s: float | None = None
    robot: str | None = None
    """Robot id, or None for all robots."""

    def opened(self) -> Recording:
        """Open the recording.

        Raises:
            TwinError: If the recording cannot be read, lacks the robot, or does not contain the
                time range.
        """
        recording = open_recording(self.path)
        if self.robot is not None and self.robot not in recording.robots:
            raise TwinError(
                f"{self.path} has no robot '{self.robot}', but {', '.join(recording.robots)}"
            )
        end_s = recording.duration_s if self.end_s is None else self.end_s
        if not 0.0 <= self.start_s < max(end_s, 1e-9) or self.start_s > recording.duration_s:
            raise TwinError(
                f"--from {self.start_s:g} --to {end_s:g} is no part of {recording.duration_s:.1f} s"
            )
        return recording


def to_mcap(part: RecordingSlice, out: Path) -> str:
    """Write the range as MCAP with lease ids replaced; return a summary.

    The file begins with the robot descriptions and the input log since the previous controller
    state, so that it can be rerun from its start. Marks are copied too.

    Raises:
        TwinError: If the range is empty, or the file exists or cannot be written.
    """
    recording = part.opened()
    redactor, count = Redactor(), 0
    try:
        with out.open("xb") as file:
            writer = McapWriter(file)
            for entry in _entries(part, recording):
                writer.add(redactor.entry(entry))
                count += 1
            writer.finish()
            file.flush()
            os.fsync(file.fileno())
    except FileExistsError as error:
        raise TwinError(f"{out} is there already: choose another file") from error
    except OSError as error:
        raise TwinError(f"{out} cannot be written: {error.strerror}") from error
    end_s = recording.duration_s if part.end_s is None else part.end_s
    start_ns, end_ns = (recording.start_ns + round(t_s * 1e9) for t_s in (part.start_s, end_s))
    for mark in read_marks(part.path):
        if start_ns <= mark.log_ns <= end_ns:
            add_mark(out, mark)
    return f"wrote {out}: {count} messages"


def to_csv(part: RecordingSlice, folder: Path) -> list[str]:
    """Write each stream of the range as a CSV file; return a summary per file.

    Raises:
        TwinError: If the range is empty or a file cannot be written.
    """
    recording = part.opened()
    lines: list[str] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for topic, summary in recording.topics.items():
            robot = robot_of(topic)
            skipped = summary.type == MSGPACK or topic.endswith((RAW, f"/{Service.DESC}"))
            if skipped or part.robot not in (None, robot):
                continue
            series = recording.read(topic, start_s=part.start_s, end_s=part.end_s)
            if not len(series.t_s):
                continue
            path = folder / (topic.removeprefix("twin/").replace("/", "_") + ".csv")
            columns = series.table()
            with path.open("w", newline="", encoding="utf-8") as file:
                writer = csv.writer(file)
                writer.writerow(columns)
                writer.writerows(
                    zip(*(map(_cell, column.tolist()) for column in columns.values()), strict=True)
                )
            lines.append(f"wrote {path}: {len(series.t_s)} rows")
    except OSError as error:
        raise TwinError(f"{folder} cannot be written to: {error.strerror}") from error
    return lines


def _cell(value: object) -> object:
    if isinstance(value, float):
        return "" if np.isnan(value) else repr(value)
    return value


def _entries(part: RecordingSlice, recording: Recording) -> Iterator[Entry]:
    start_ns = recording.start_ns + round(part.start_s * 1e9)
    end_ns = None if part.end_s is None else recording.start_ns + round(part.end_s * 1e9)
    if part.start_s > 0.0:
        for entry in _before(part, recording, start_ns):
            yield entry._replace(log_ns=start_ns)
    for entry in mcap_file.entries(part.path, from_ns=start_ns, until_ns=end_ns):
        if part.robot in (None, robot_of(entry.topic)):
            yield entry


def _before(part: RecordingSlice, recording: Recording, start_ns: int) -> Iterator[Entry]:
    """Yield the entries before the range that are required to use it."""
    kept: dict[str, list[Entry]] = {}
    needed = {
        topic
        for topic in recording.topics
        if topic.endswith(("/alive", f"/{Service.DESC}", f"/{topics.INPUTS.path}"))
        and part.robot in (None, robot_of(topic))
    }
    for entry in mcap_file.entries(part.path, needed, until_ns=start_ns):
        if topic_of(entry.topic) is topics.INPUTS and not _begins(entry):
            kept.setdefault(entry.topic, []).append(entry)
        else:
            kept[entry.topic] = [entry]
    for found in kept.values():
        yield from found


def _begins(entry: Entry) -> bool:
    """Return whether a rerun can start at this input log entry."""
    try:
        batch = decode_batch(entry.data)
    except MessageError:
        return False
    return batch.first == 0 or batch.snapshot is not None


_HEX_ID = re.compile(rb"[0-9a-f]{32}")
_LEASE = slice(8, 24)
"""Bytes of the lease id in a command attachment, which has 32 bytes."""
_ATTACHMENT_BYTES = 32


class Redactor:
    """Replaces lease ids. Reruns still work, because ids are only compared.

    The replacement depends on a secret that is discarded, so original ids cannot be recovered.
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
        """Replace all ids in JSON text."""
        return _HEX_ID.sub(
            lambda found: self.id(bytes.fromhex(found[0].decode())).hex().encode(), data
        )

    def attachment(self, attachment: bytes) -> bytes:
        """Replace the id in a command attachment; other attachments are blanked."""
        if len(attachment) != _ATTACHMENT_BYTES:
            return bytes(len(attachment))
        changed = bytearray(attachment)
        changed[_LEASE] = self.id(attachment[_LEASE])
        return bytes(changed)

    def _raw(self, data: bytes) -> bytes:
        raw = msgspec.json.decode(data, type=RawMessage)
        attachment = self.attachment(bytes.fromhex(raw.attachment)).hex()
        # Undecodable payloads may contain anything.
        payload = None if raw.payload is None else ""
        return msgspec.json.encode(RawMessage(attachment, payload, raw.put))

    def _batch(self, data: bytes) -> bytes:
        batch = decode_batch(data)
        snapshot = batch.snapshot
        if snapshot is not None:
            state = snapshot.state
            for lease in snapshot.leases:
                state = state.replace(lease, self.id(lease))
            leases = [self.id(each) for each in snapshot.leases]
            snapshot = replace(snapshot, state=state, leases=leases)
        calls = [self._call(call) for call in batch.calls]
        return encode_batch(replace(batch, calls=calls, snapshot=snapshot))

    def _call(self, call: Call) -> Call:
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
