"""Index of a recording by topic and chunk, for fast access by time.

Complete files end with this index. A file that is being written, or was truncated, is scanned once;
`refresh` resumes at the end of the last scan.
"""

from __future__ import annotations

import bisect
import heapq
import itertools
from collections import OrderedDict
from collections.abc import Collection, Iterator
from pathlib import Path

from mcap.opcode import Opcode

from tsd_twin.errors import RecordingError
from tsd_twin.recording.channels import Entry
from tsd_twin.recording.records import (
    MAGIC,
    MOST_CHUNKS,
    MOST_INDEXED,
    Channels,
    Place,
    RecordFile,
    readable,
)

_KEPT_BYTES = 24 << 20
"""Memory for decompressed chunks, about ten seconds of five robots."""
_MOST_PENDING_BYTES = 64 << 20
"""Memory for messages of chunks that overlap in time."""
_MOST_VISITED = 200
"""Maximum chunks read to find one message; a recorder's chunks overlap by a few."""
_MESSAGE_BYTES = 400
"""Memory overhead per message."""


class _Chunks:
    """Chunks that contain messages of a topic, sorted by start."""

    def __init__(self) -> None:
        self._places: list[Place] = []
        self._starts_ns: list[int] = []
        self._ends_ns: list[int] = []
        """Running maximum of the chunk ends, because threads may log messages out of order."""

    def add(self, place: Place) -> None:
        """Add a chunk, usually in order of time."""
        if self._places and place < self._places[-1]:
            self._starts_ns, self._ends_ns = [], []  # Rebuilt at the next use.
        elif len(self._starts_ns) == len(self._places):
            self._starts_ns.append(place.start_ns)
            self._ends_ns.append(max(place.end_ns, self._ends_ns[-1] if self._ends_ns else 0))
        self._places.append(place)

    def sorted(self) -> tuple[list[Place], list[int], list[int]]:
        """Return the chunks by start, their starts, and the running maximum of their ends."""
        if len(self._starts_ns) != len(self._places):
            self._places.sort()
            self._starts_ns = [place.start_ns for place in self._places]
            self._ends_ns = list(itertools.accumulate((p.end_ns for p in self._places), max))
        return self._places, self._starts_ns, self._ends_ns


class _Pending:
    """Messages held back until overlapping chunks are read, sorted by time and position."""

    def __init__(self, path: Path, sign: int = 1) -> None:
        """`sign` is 1 for oldest first, -1 for latest first."""
        self._path, self._sign, self._bytes = path, sign, 0
        self._heap: list[tuple[int, int, int, Entry]] = []
        """Time, chunk offset, number in the chunk, message; positions are unique."""

    @property
    def first_ns(self) -> int | None:
        """Time of the next message, or None if empty."""
        return self._sign * self._heap[0][0] if self._heap else None

    def add(self, place: Place, number: int, entry: Entry) -> None:
        """Add a message.

        Raises:
            RecordingError: If too many messages are pending.
        """
        self._bytes += _cost(entry)
        if self._bytes > _MOST_PENDING_BYTES:
            raise RecordingError(f"{self._path} is damaged: too many of its chunks overlap")
        sign = self._sign
        key = sign * entry.log_ns, sign * place.offset, sign * number
        heapq.heappush(self._heap, (*key, entry))

    def pop_before(self, limit_ns: int) -> Iterator[Entry]:
        """Remove and yield all messages before `limit_ns` (after it, if latest first)."""
        while self._heap and self._heap[0][0] < self._sign * limit_ns:
            entry = heapq.heappop(self._heap)[-1]
            self._bytes -= _cost(entry)
            yield entry


def _cost(entry: Entry) -> int:
    return len(entry.data) + _MESSAGE_BYTES


class RecordingIndex:
    """Index of a file, which stays open; finds messages by topic and time.

    Reading raises a `RecordingError` if the file is damaged there, or too many chunks overlap.
    """

    def __init__(self, path: Path) -> None:
        """Read the index, or scan the file if it has none.

        Raises:
            RecordingError: If the file is not a recording.
        """
        self.path = path
        self.start_ns = self.end_ns = 0
        """Time of the first and last message, recorder's wall clock; 0 if empty."""
        self.channels = Channels()
        self._topics: dict[str, _Chunks] = {}
        self._chunks = self._indexed = self._parsed_bytes = 0
        self._parsed: OrderedDict[int, tuple[int, dict[str, list[Entry]]]] = OrderedDict()
        self._walked = len(MAGIC)
        self._file = RecordFile(path)
        self.is_whole = self._file.is_whole
        """Whether the file is complete; otherwise it may be growing."""
        try:
            if self.is_whole:
                self._read_summary()
            else:
                self.refresh()
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @property
    def topics(self) -> Collection[str]:
        """Topics with messages."""
        return self._topics.keys()

    def newest_first(self, topic: str, at_ns: int) -> Iterator[Entry]:
        """Yield the messages of a topic up to a time, latest first.

        Messages with equal times are yielded in reverse order of writing.
        """
        chunks = self._topics.get(topic)
        if chunks is None:
            return
        places, starts_ns, ends_ns = chunks.sorted()
        pending, visited = _Pending(self.path, -1), 0
        for i in range(bisect.bisect_right(starts_ns, at_ns) - 1, -1, -1):
            visited = self._visited(visited)
            for number, entry in enumerate(self._messages(places[i]).get(topic, [])):
                if entry.log_ns <= at_ns:
                    pending.add(places[i], number, entry)
            for entry in pending.pop_before(ends_ns[i - 1] if i else -1):
                visited = 0
                yield entry

    def first_after(self, topic: str, at_ns: int) -> Entry | None:
        """Return the first message of a topic after a time, or None."""
        chunks = self._topics.get(topic)
        if chunks is None:
            return None
        places, _, ends_ns = chunks.sorted()
        pending, visited = _Pending(self.path), 0
        for place in places[bisect.bisect_right(ends_ns, at_ns) :]:
            first_ns = pending.first_ns
            if first_ns is not None and place.start_ns > first_ns:
                break
            visited = self._visited(visited)
            for number, entry in enumerate(self._messages(place).get(topic, [])):
                if entry.log_ns > at_ns:
                    pending.add(place, number, entry)
        return next(pending.pop_before(1 << 64), None)

    def _visited(self, count: int) -> int:
        """Count a chunk read to find one message."""
        if count >= _MOST_VISITED:
            raise RecordingError(f"{self.path} is damaged: too many of its chunks overlap")
        return count + 1

    def ordered(
        self, topics: Collection[str] | None, from_ns: int = 0, until_ns: int = 1 << 64
    ) -> Iterator[Entry]:
        """Yield the messages of some topics, or all, in [from_ns, until_ns), in order of time."""
        wanted = self.topics if topics is None else topics
        chunks = [self._topics[topic] for topic in wanted if topic in self._topics]
        places = {place for each in chunks for place in each.sorted()[0] if place.end_ns >= from_ns}
        pending = _Pending(self.path)
        for place in sorted(places):
            if place.start_ns >= until_ns:
                break
            yield from pending.pop_before(place.start_ns)
            for number, entry in enumerate(self._file.entries(place, self.channels, topics)):
                if from_ns <= entry.log_ns < until_ns:
                    pending.add(place, number, entry)
        yield from pending.pop_before(until_ns)

    def refresh(self) -> None:
        """Add data written to a growing file since the last call."""
        if not self.is_whole:
            with readable(self.path):
                self._walk(self._file.size)

    def _read_summary(self) -> None:
        summary = self._file.summary()
        self.channels = summary.channels
        for place, channels in summary.chunks:
            self._add(place, channels)

    def _add(self, place: Place, channels: Collection[int]) -> None:
        topics = {about[0] for number in channels if (about := self.channels.of(number))}
        if not topics:
            return
        self._chunks, self._indexed = self._chunks + 1, self._indexed + len(topics)
        if self._chunks > MOST_CHUNKS or self._indexed > MOST_INDEXED:
            raise RecordingError(f"{self.path} cannot be read: it has too many chunks")
        for topic in topics:
            self._topics.setdefault(topic, _Chunks()).add(place)
        self.start_ns = min(self.start_ns or place.start_ns, place.start_ns)
        self.end_ns = max(self.end_ns, place.end_ns)

    def _walk(self, size: int) -> None:
        """Add all complete chunks with their message indexes."""
        channels, last = set[int](), None
        for kind, at, length in self._file.walk(self._walked, size):
            if kind == Opcode.MESSAGE_INDEX and last is not None:
                channels.add(self._file.channel_of_index(at))
                continue
            if last is not None:
                self._learn(last, channels)
                channels, last = set[int](), None
            if kind == Opcode.CHUNK:
                last = self._file.place(at, length)
                self._walked = last.offset + last.length
            else:
                self._walked = at + length
        if last is not None:
            self._learn(last, None)  # Its message indexes may still be incomplete.

    def _learn(self, place: Place, channels: set[int] | None) -> None:
        """Add a chunk with messages of these channels; if unknown, read the chunk to find them."""
        if channels is not None and all(number in self.channels for number in channels):
            self._add(place, channels)
            return
        topics = {entry.topic for entry in self._file.entries(place, self.channels)}
        self._add(place, self.channels.wanted(topics))

    def _messages(self, place: Place) -> dict[str, list[Entry]]:
        """Return the messages of a chunk by topic, in the order written."""
        if (known := self._parsed.get(place.offset)) is not None:
            self._parsed.move_to_end(place.offset)
            return known[1]
        parsed: dict[str, list[Entry]] = {}
        size = 0
        for entry in self._file.entries(place, self.channels):
            parsed.setdefault(entry.topic, []).append(entry)
            size += _cost(entry)
        self._parsed[place.offset] = size, parsed
        self._parsed_bytes += size
        while self._parsed_bytes > _KEPT_BYTES and len(self._parsed) > 1:
            self._parsed_bytes -= self._parsed.popitem(last=False)[1][0]
        return parsed
