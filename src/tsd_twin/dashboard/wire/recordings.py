"""Rows of the list of recordings and of the trash, sent as JSON over HTTP."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from tsd_twin.dashboard.wire.to_page import RecordedPath


class RowDetails(msgspec.Struct, frozen=True):
    """Details of a recording, read in the background."""

    drivers: Sequence[str]
    """Operators who had control, in order of time."""
    stops: int
    faults: int
    paths: Sequence[RecordedPath]


class RecordedLanes(msgspec.Struct, frozen=True):
    """Values of a robot at evenly spaced times from the start to `end_s`; null while silent."""

    robot: str
    end_s: float
    modes: Sequence[str | None]
    drivers: Sequence[str | None]
    """Display name of the lease holder, or its id without one; null also without a holder."""
    speeds: Sequence[float | None]
    """Estimated speed in m/s, or rad/s for a sphere."""


class RecordingRow(msgspec.Struct, frozen=True):
    """Recording in the list."""

    name: str
    """File name, which never changes; use it in links."""
    title: str
    """Title that people gave it, empty if none."""
    start_ms: int
    """Wall-clock time of the recorder at the start."""
    duration_s: float
    robots: Sequence[str]
    size_bytes: int
    writing: bool
    """Whether a recorder is writing it; it cannot be deleted then."""
    marks: int
    """Number of marks."""
    notes: Sequence[str]
    """Texts of the first marks."""
    details: RowDetails | None
    """Null if not read yet, or unreadable."""
    details_pending: bool
    """Whether the details are still to be read; `recordings_changed` reports progress."""


class TrashRow(msgspec.Struct, frozen=True):
    """Deleted recording that can be restored."""

    id: str
    name: str
    title: str
    by: str
    """Operator who deleted it."""
    deleted_ms: int
    """Wall-clock time."""
    size_bytes: int
