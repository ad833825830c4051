"""Recordings as numpy arrays: `open_recording` reads a file written by `tsd-record`."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, cast

import msgspec
import numpy as np
from numpy.typing import NDArray

from tsd_twin.errors import RecordingError
from tsd_twin.lie import Array
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.ros_types import decode_cdr
from tsd_twin.messages.services import Description
from tsd_twin.messages.topics import Service
from tsd_twin.recording import mcap_file
from tsd_twin.recording.channels import (
    CDR,
    JSON,
    MSGPACK,
    RAW,
    Entry,
    robot_of,
    robots_in,
    topic_of,
)

Column: TypeAlias = NDArray[Any]
_STATE = "/state/"
_EXACT = 1 << 63


@dataclasses.dataclass(frozen=True, slots=True)
class TopicSummary:
    """Topic of a recording with its type and message count."""

    topic: str
    type: str
    """ROS 2 type, or encoding of other messages: `json`, `msgpack`."""
    count: int
    """Number of messages."""


class RecordedMessage(NamedTuple):
    """Decoded message of a recording."""

    t_s: float
    """Time of receipt by the recorder, since the start of the recording."""
    topic: str
    """Bus key, such as `twin/tsd/state/odom`."""
    value: Any
    """ROS 2 message with its fields as attributes, or decoded JSON or MessagePack."""
    robot_s: float | None
    """Robot's monotonic clock for states, else None."""
    sequence: int
    """Sequence number of the message on its topic."""


class Series(Mapping[str, Column]):
    """All messages of a topic as arrays: `series["pose.pose.position.x"]` is (n,).

    Lists of equal length are (n, k). Joint columns are named, such as `position.module1_alpha`.
    Missing numbers are NaN; text and values of varying shape are object arrays.
    """

    def __init__(self, topic: str, t_s: Array, robot_s: Array, columns: dict[str, Column]) -> None:
        self.topic = topic
        self.t_s = t_s
        """(n,): time of receipt by the recorder, since the start of the recording."""
        self.robot_s = robot_s
        """(n,): robot's monotonic clock for states, else NaN."""
        self._columns = columns

    def __getitem__(self, field: str) -> Column:
        try:
            return self._columns[field]
        except KeyError:
            near = ", ".join(self._columns)
            raise KeyError(f"{self.topic} has no field '{field}', but {near}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    def __repr__(self) -> str:
        return f"<{self.topic}: {len(self.t_s)} messages, {len(self)} fields>"

    def table(self) -> dict[str, Column]:
        """Return one-dimensional columns for pandas or CSV: `t_s`, `robot_s`, fields.

        A field (n, k) is split into k columns, `field.0` and so on.
        """
        columns: dict[str, Column] = {"t_s": self.t_s}
        if np.isfinite(self.robot_s).any():
            columns["robot_s"] = self.robot_s
        for name, column in self._columns.items():
            if column.ndim == 1:
                columns[name] = column
            else:
                columns |= {f"{name}.{i}": each for i, each in enumerate(column.T)}
        return columns


class Recording:
    """Recording written by `tsd-record`; each call reads only the required part of the file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        listed, start_ns, end_ns = mcap_file.summary(path)
        self.topics: dict[str, TopicSummary] = {
            topic: TopicSummary(topic, ros_type or encoding, count)
            for topic, encoding, ros_type, count in listed
        }
        """All topics by name."""
        self.robots: tuple[str, ...] = tuple(robots_in(self.topics))
        """Robot ids."""
        self.start_ns = start_ns
        """Start of the recording, recorder's wall clock."""
        self.duration_s = (end_ns - start_ns) * 1e-9

    def __repr__(self) -> str:
        robots = ", ".join(self.robots)
        return f"<{self.path.name}: {self.duration_s:.1f} s of {robots}>"

    def read(
        self,
        topic: str,
        *,
        robot: str | None = None,
        start_s: float = 0.0,
        end_s: float | None = None,
    ) -> Series:
        """Return all messages of a topic as arrays.

        Args:
            topic: Key below `twin/<robot>/`, such as `state/odom`.
            robot: Robot id; required if the recording contains several robots.
            start_s: Start, relative to the start of the recording.
            end_s: End, relative to the start of the recording.

        Raises:
            RecordingError: If the topic does not exist or the file is damaged.
        """
        key = self._key(topic, robot)
        found = list(self._entries([key], start_s, end_s))
        is_state = _STATE in key
        return Series(
            key,
            np.array([self._time_s(entry) for entry in found]),
            np.array([entry.publish_ns * 1e-9 if is_state else math.nan for entry in found]),
            _columns([_decoded(entry) for entry in found]),
        )

    def messages(
        self,
        *topics: str,
        robot: str | None = None,
        start_s: float = 0.0,
        end_s: float | None = None,
    ) -> Iterator[RecordedMessage]:
        """Yield the messages of some topics, or of all if none is given, in order of time.

        Bus topics without messages, such as an event that never occurred, yield nothing.

        Raises:
            RecordingError: If a topic does not exist or the file is damaged.
        """
        keys = [self._key(topic, robot) for topic in topics]
        if not keys:
            keys = [key for key in self.topics if robot in (None, robot_of(key))]
        for entry in self._entries(keys, start_s, end_s):
            robot_s = entry.publish_ns * 1e-9 if _STATE in entry.topic else None
            yield RecordedMessage(
                self._time_s(entry), entry.topic, _decoded(entry), robot_s, entry.sequence
            )

    def description(self, robot: str | None = None) -> str:
        """Return the robot description (TOML) at the start of the recording.

        Raises:
            RecordingError: If the file does not contain it.
        """
        for message in self.messages(Service.DESC, robot=robot):
            try:
                return msgspec.convert(message.value, Description).robot
            except msgspec.ValidationError:
                continue  # Third-party robot.
        raise RecordingError(f"{self.path} has no description of the robot")

    def _key(self, topic: str, robot: str | None) -> str:
        if topic in self.topics:
            return topic
        if robot is None and len(self.robots) > 1:
            raise RecordingError(
                f"{', '.join(self.robots)} are in {self.path}: name one, robot='{self.robots[0]}'"
            )
        named = robot or (self.robots[0] if self.robots else "")
        key = f"twin/{named}/{topic}"
        if key not in self.topics and (topic_of(key) is None or named not in self.robots):
            known = ", ".join(sorted(self.topics)) or "nothing"
            raise RecordingError(f"{self.path} has no {key}, but {known}")
        return key

    def _entries(self, keys: Sequence[str], start_s: float, end_s: float | None) -> Iterator[Entry]:
        return mcap_file.entries(
            self.path,
            frozenset(keys),
            from_ns=self.start_ns + round(start_s * 1e9),
            until_ns=None if end_s is None else self.start_ns + round(end_s * 1e9),
        )

    def _time_s(self, entry: Entry) -> float:
        return (entry.log_ns - self.start_ns) * 1e-9


def open_recording(path: str | Path) -> Recording:
    """Open a file written by `tsd-record`, even if it is still being written or truncated.

    Raises:
        RecordingError: If the file is not a recording.
    """
    return Recording(Path(path))


def _decoded(entry: Entry) -> Any:
    try:
        if entry.encoding == CDR:
            return decode_cdr(entry.data, entry.type)
        if entry.encoding == JSON or entry.topic.endswith(RAW):
            return msgspec.json.decode(entry.data)
        if entry.encoding == MSGPACK:
            return msgspec.msgpack.decode(entry.data)
    except (MessageError, msgspec.DecodeError, KeyError, UnicodeError, RecursionError) as error:
        raise RecordingError(f"{entry.topic}: {error}") from error
    return entry.data


def _columns(values: list[Any]) -> dict[str, Column]:
    """Return the fields of a topic's messages as columns."""
    if not values:
        return {}
    if dataclasses.is_dataclass(values[0]):
        paths = [path for path in _paths(values[0]) if not path.endswith("__msgtype__")]
        found = {path: _column(list(map(attrgetter(path), values))) for path in paths}
        return _by_joint(found, values[0])
    rows = [dict(_flat(value)) for value in values]
    names = {name: None for row in rows for name in row}
    return {name: _column([row.get(name) for row in rows]) for name in names}


def _by_joint(columns: dict[str, Column], first: Any) -> dict[str, Column]:
    """Split joint columns by joint name if all messages list the same joints."""
    names = columns.get("name")
    if names is None or not isinstance(getattr(first, "name", None), list):
        return columns
    joints = list(first.name)
    if any(list(row) != joints for row in names):
        return columns
    named: dict[str, Column] = {}
    for field, column in columns.items():
        if field == "name":
            continue
        if column.ndim == 2 and column.shape[1] == len(joints):
            named |= {f"{field}.{joint}": column[:, i] for i, joint in enumerate(joints)}
        elif column.size:
            named[field] = column
    return named


def _paths(message: Any, above: str = "") -> Iterator[str]:
    for field in dataclasses.fields(message):
        value = getattr(message, field.name)
        path = f"{above}{field.name}"
        if dataclasses.is_dataclass(value):
            yield from _paths(value, f"{path}.")
        else:
            yield path


def _flat(value: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict) and value:
        for name, part in cast("dict[str, Any]", value).items():
            yield from _flat(part, f"{above}.{name}" if above else name)
    else:
        yield above or "value", value


def _column(values: list[Any]) -> Column:
    """Return a numeric column if all values are numbers or missing, else an object column."""
    if all(type(value) is int and abs(value) < _EXACT for value in values):
        return np.array(values, dtype=np.int64)
    if all(value is None or isinstance(value, int | float) for value in values):
        return np.array([math.nan if value is None else float(value) for value in values])
    if all(isinstance(value, np.ndarray | list) for value in values):
        lengths = {len(value) for value in values}
        plain = all(isinstance(part, int | float) for value in values for part in value)
        if len(lengths) == 1 and plain:
            return np.array(values, dtype=float)
    column = np.empty(len(values), dtype=object)
    column[:] = values
    return column
