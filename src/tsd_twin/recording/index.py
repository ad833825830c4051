"""Index of a recording: which chunks have messages of a topic, so that any time is found at once.

A whole file has this index at its end. One that is being written, or was cut, is walked over
once, from record to record; `refresh` goes on where the last walk ended.
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
"""Memory for decompressed chunks: some ten seconds of five robots."""
_MOST_PENDING_BYTES = 64 << 20
"""Memory for messages of chunks whose times overlap."""
_MOST_VISITED = 200
"""Chunks that are read to find one message: those of a recorder overlap by a few."""
_MESSAGE_BYTES = 400
"""Memory of a message in addition to its payload."""


class _Chunks:
    """Chunks that have messages of one topic, by their start."""

    def __init__(self) -> None:
        self._places: list[Place] = []
        self._starts_ns: list[int] = []
        self._ends_ns: list[int] = []
        """Latest end of all chunks up to each: threads may number messages out of order."""

    def add(self, place: Place) -> None:
        """Add a chunk; nearly all are added in the order of time."""
        if self._places and place < self._places[-1]:
            self._starts_ns, self._ends_ns = [], []  # Sorted and made again at the next use.
        elif len(self._starts_ns) == len(self._places):
            self._starts_ns.append(place.start_ns)
            self._ends_ns.append(max(place.end_ns, self._ends_ns[-1] if self._ends_ns else 0))
        self._places.append(place)

    def sorted(self) -> tuple[list[Place], list[int], list[int]]:
        """Chunks by their start; their starts; the latest end of all chunks up to each."""
        if len(self._starts_ns) != len(self._places):
            self._places.sort()
            self._starts_ns = [place.start_ns for place in self._places]
            self._ends_ns = list(itertools.accumulate((p.end_ns for p in self._places), max))
        return self._places, self._starts_ns, self._ends_ns


class _Pending:
    """Messages that wait for those of other chunks, by time and place."""

    def __init__(self, path: Path, sign: int = 1) -> None:
        """`sign` is 1 for the oldest first, -1 for the newest first."""
        self._path, self._sign, self._bytes = path, sign, 0
        self._heap: list[tuple[int, int, int, Entry]] = []
        """Time, offset of the chunk, number in it, message; no two are in one place."""

    @property
    def first_ns(self) -> int | None:
        """Time of the next message; None if none waits."""
        return self._sign * self._heap[0][0] if self._heap else None

    def add(self, place: Place, number: int, entry: Entry) -> None:
        """Add a message.

        Raises:
            RecordingError: If too many wait.
        """
        self._bytes += _cost(entry)
        if self._bytes > _MOST_PENDING_BYTES:
            raise RecordingError(f"{self._path} is damaged: too many of its chunks overlap")
        sign = self._sign
        key = sign * entry.log_ns, sign * place.offset, sign * number
        heapq.heappush(self._heap, (*key, entry))

    def pop_before(self, limit_ns: int) -> Iterator[Entry]:
        """Remove and yield all on this side of a time."""
        while self._heap and self._heap[0][0] < self._sign * limit_ns:
            entry = heapq.heappop(self._heap)[-1]
            self._bytes -= _cost(entry)
            yield entry


def _cost(entry: Entry) -> int:
    return len(entry.data) + _MESSAGE_BYTES


class RecordingIndex:
    """Index of one file, which stays open; messages of a topic are found by time."""

    def __init__(self, path: Path) -> None:
        """Read the index, or walk over a file that has none.

        Raises:
            RecordingError: it is no recording.
        """
        self.path = path
        self.start_ns = self.end_ns = 0
        """Wall clock of the recorder at the first and the last message; 0 without any."""
        self.channels = Channels()
        self._topics: dict[str, _Chunks] = {}
        self._chunks = self._indexed = self._parsed_bytes = 0
        self._parsed: OrderedDict[int, tuple[int, dict[str, list[Entry]]]] = OrderedDict()
        self._walked = len(MAGIC)
        self._file = RecordFile(path)
        self.is_whole = self._file.is_whole
        """Whether the file is closed; otherwise it may be growing."""
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
        """All topics that have messages."""
        return self._topics.keys()

    def newest_first(self, topic: str, at_ns: int) -> Iterator[Entry]:
        """Yield the messages of a topic up to a time, the newest first.

        Of messages with the same time the one that was written last is the newest.

        Raises:
            RecordingError: the file is damaged there.
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
        """Return the oldest message of a topic after a time; None when there is none.

        Raises:
            RecordingError: the file is damaged there.
        """
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
        """Count a chunk that is read to find one message.

        Raises:
            RecordingError: There were too many.
        """
        if count >= _MOST_VISITED:
            raise RecordingError(f"{self.path} is damaged: too many of its chunks overlap")
        return count + 1

    def entries(self, topics: Collection[str], after_ns: int = -1) -> Iterator[Entry]:
        """Yield the messages of some topics after a time, about in the order of time.

        Raises:
            RecordingError: the file is damaged.
        """
        for place in self._places(topics, after_ns):
            for entry in self._file.entries(place, self.channels, topics):
                if entry.log_ns > after_ns:
                    yield entry

    def ordered(
        self, topics: Collection[str] | None, from_ns: int = 0, until_ns: int = 1 << 64
    ) -> Iterator[Entry]:
        """Yield the messages of some topics or of all, from a time until another, in order.

        Raises:
            RecordingError: the file is damaged.
        """
        pending = _Pending(self.path)
        for place in self._places(self.topics if topics is None else topics, from_ns - 1):
            if place.start_ns >= until_ns:
                break
            yield from pending.pop_before(place.start_ns)
            for number, entry in enumerate(self._file.entries(place, self.channels, topics)):
                if from_ns <= entry.log_ns < until_ns:
                    pending.add(place, number, entry)
        yield from pending.pop_before(until_ns)

    def _places(self, topics: Collection[str], after_ns: int) -> list[Place]:
        """Chunks with some topics that end after a time, by their start."""
        chunks = [self._topics[topic] for topic in topics if topic in self._topics]
        return sorted(
            {place for each in chunks for place in each.sorted()[0] if place.end_ns > after_ns}
        )

    def refresh(self) -> None:
        """Take in what was written to a growing file since the last call."""
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
        """Take in all chunks that are complete, with their message indexes."""
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
            self._learn(last, None)  # The rest of its message indexes may be still to come.

    def _learn(self, place: Place, channels: set[int] | None) -> None:
        """Take in a chunk with messages of these channels, or of those that are found in it."""
        if channels is not None and all(number in self.channels for number in channels):
            self._add(place, channels)
            return
        topics = {entry.topic for entry in self._file.entries(place, self.channels)}
        self._add(place, self.channels.wanted(topics))

    def _messages(self, place: Place) -> dict[str, list[Entry]]:
        """Return the messages of a chunk by topic, in the order in which they were written."""
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
