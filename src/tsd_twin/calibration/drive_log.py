"""Recording of a drive: joints and camera poses on one clock; from bus samples, to and from CSV."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from tsd_twin.errors import TwinError
from tsd_twin.lie import SE2, Array
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import decode_joints
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.pose import decode_pose_measurement
from tsd_twin.messages.status import RobotStatus, decode_stamp, decode_status, encode_stamp
from tsd_twin.messages.topics import Sample
from tsd_twin.recording import open_recording
from tsd_twin.recording.mcap_file import entries
from tsd_twin.robots import SingularityDescription

_Row: TypeAlias = dict[str, float]
_POSE_COLUMNS = ("x_m", "y_m", "heading_rad")


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Joints and camera poses of a drive, on one clock."""

    t_s: Array
    """(n,): times, increasing."""
    angles_rad: Array
    """(n, 2k): alpha and beta of each module, measured, as in `state/joints`."""
    commanded_rad_per_s: Array
    """(n, k): wheel-speed setpoints as in `state/setpoint`. If the battery voltage is known, scaled
    by its ratio to the nominal voltage, because motor speed is proportional to it."""
    spin_rad_per_s: Array
    """(n, k): measured wheel speeds, NaN without a sensor."""
    camera_s: Array
    """(m,): times of the camera poses, on the same clock, within `t_s`."""
    camera_poses: Array
    """(m, 3): x, y and unwrapped heading."""

    @property
    def modules(self) -> int:
        """Number of wheels."""
        return self.commanded_rad_per_s.shape[1]

    def part(self, first_s: float, last_s: float) -> Recording:
        """Return the part between two times."""
        rows = (self.t_s >= first_s) & (self.t_s <= last_s)
        t_s = self.t_s[rows]
        frames = (self.camera_s >= t_s[0]) & (self.camera_s <= t_s[-1])
        return Recording(
            t_s,
            self.angles_rad[rows],
            self.commanded_rad_per_s[rows],
            self.spin_rad_per_s[rows],
            self.camera_s[frames],
            self.camera_poses[frames],
        )


def recording_columns(recordings: Sequence[Recording]) -> dict[str, Array]:
    """Return recordings as a table; joints and poses at the same time share a row."""
    table: dict[str, list[Array]] = {}
    for number, run in enumerate(recordings):
        t_s = np.union1d(run.t_s, run.camera_s)
        angles, commanded, measured = _column_names(run.modules)
        groups = [
            (angles, run.t_s, run.angles_rad),
            (commanded, run.t_s, run.commanded_rad_per_s),
            (measured, run.t_s, run.spin_rad_per_s),
            (_POSE_COLUMNS, run.camera_s, run.camera_poses),
        ]
        named = {"run": np.full(len(t_s), float(number)), "t_s": t_s}
        for names, times, values in groups:
            rows = np.full((len(t_s), len(names)), np.nan)
            rows[np.searchsorted(t_s, times)] = values
            named |= dict(zip(names, rows.T, strict=True))
        for name, column in named.items():
            table.setdefault(name, []).append(column)
    return {name: np.concatenate(parts) for name, parts in table.items()}


def _column_names(modules: int) -> tuple[list[str], list[str], list[str]]:
    """Return the columns of gimbal angles, commanded wheel speeds and measured wheel speeds."""
    names = [f"module{i + 1}" for i in range(modules)]
    return (
        [f"{name}_{part}_rad" for name in names for part in ("alpha", "beta")],
        [f"{name}_wheel_told_rad_per_s" for name in names],
        [f"{name}_wheel_rad_per_s" for name in names],
    )


def read_recordings(file: str, robot: SingularityDescription) -> list[Recording]:
    """Read the drives in a recording of `tsd-record`, or in a CSV file of `recording_columns`.

    In CSV files, empty or `nan` means not measured. A row may contain joints, a pose, or both.
    Measured wheel speeds are optional.

    Raises:
        TwinError: If the file cannot be read, lacks a column, or has too few rows.
    """
    if file.endswith(".mcap"):
        return _read_mcap(Path(file), robot)
    modules = robot.drive.modules
    try:
        with Path(file).open(newline="", encoding="utf-8") as opened:
            rows = [
                {name: float(value or "nan") for name, value in row.items()}
                for row in csv.DictReader(opened)
            ]
    except (OSError, ValueError, TypeError) as error:
        raise TwinError(f"{file} cannot be read as a log: {error}") from error
    angles, commanded, _ = _column_names(modules)
    needed = ["t_s", *angles, *_POSE_COLUMNS, *commanded]
    missing = [name for name in needed if not rows or name not in rows[0]]
    if missing:
        raise TwinError(f"{file}: no column {missing[0]} (needed are {', '.join(needed)})")
    runs = sorted({row.get("run", 0.0) for row in rows})
    return [
        _parse_recording([row for row in rows if row.get("run", 0.0) == run], modules, file)
        for run in runs
    ]


def _read_mcap(path: Path, robot: SingularityDescription) -> list[Recording]:
    """Return one recording per period in which the robot was ready or driving, if it moved."""
    found = open_recording(path)
    if len(found.robots) != 1:
        raise TwinError(
            f"{path} has {len(found.robots)} robots: export one, tsd-record export --robot ID"
        )
    of = found.robots[0]
    recorder = RobotRecorder(robot)
    take: dict[str, Callable[[Sample], object]] = {
        topics.JOINTS.key(of): recorder.add_joints,
        topics.SETPOINT.key(of): recorder.add_setpoint,
        topics.SENSOR_POSE.key(of): recorder.add_pose,
    }
    drives: list[_Drive] = []
    drive: _Drive | None = None
    for entry in entries(path, [*take, topics.STATUS.key(of)]):
        if entry.topic in take:
            stamp = encode_stamp(entry.sequence, entry.publish_ns)
            take[entry.topic](Sample(entry.topic, entry.data, stamp))
            continue
        try:
            status = decode_status(entry.data)
        except MessageError:
            continue
        now_s = entry.publish_ns * 1e-9
        if status.mode not in _UP:
            drive = None
            continue
        if drive is None:
            drive = _Drive(now_s)
            drives.append(drive)
        drive.take(now_s, status)
    moved = [each for each in drives if each.moved]
    if not moved:
        raise TwinError(f"{path}: the robot does not drive in it")
    return [recorder.recording(each.first_s, each.last_s, each.battery_v) for each in moved]


_UP = frozenset({Mode.READY, Mode.DRIVING})


class _Drive:
    """Period in which a robot was ready or driving."""

    def __init__(self, first_s: float) -> None:
        self.first_s = self.last_s = first_s
        self.moved = False
        self.battery_v: float | None = None

    def take(self, now_s: float, status: RobotStatus) -> None:
        self.last_s = now_s
        self.moved |= status.mode == Mode.DRIVING
        self.battery_v = battery_v(status) or self.battery_v


def battery_v(status: RobotStatus) -> float | None:
    """Return the reported battery voltage, or None."""
    volts = status.hardware.get("battery_v")
    return float(volts) if isinstance(volts, int | float) and 0.0 < volts < np.inf else None


def _parse_recording(rows: list[_Row], modules: int, file: str) -> Recording:
    rows = sorted(rows, key=lambda row: row["t_s"])
    joints, commanded, spin = (_columns_as_array(rows, names) for names in _column_names(modules))
    poses, t_s = _columns_as_array(rows, _POSE_COLUMNS), np.array([row["t_s"] for row in rows])
    have = np.isfinite(np.column_stack([t_s, joints, commanded])).all(axis=1)
    if have.sum() < 2:
        raise TwinError(f"{file}: a run needs two rows with joints or more")
    first_s, last_s = t_s[have][[0, -1]]
    seen = np.isfinite(poses).all(axis=1) & (t_s >= first_s) & (t_s <= last_s)
    if seen.sum() < 2:
        raise TwinError(f"{file}: a run needs two poses or more between its joints")
    poses[seen, 2] = np.unwrap(poses[seen, 2])
    return Recording(t_s[have], joints[have], commanded[have], spin[have], t_s[seen], poses[seen])


def _columns_as_array(rows: list[_Row], names: Sequence[str]) -> Array:
    return np.array([[row.get(name, np.nan) for name in names] for row in rows])


_MAX_POSE_AGE_S, _MAX_POSE_LEAD_S = 2.0, 0.2
"""Maximum offset of a stamp from the latest joints; beyond it the clocks differ."""
_MAX_CLOCK_JUMP_S = 0.05
"""Maximum jump of the robot's wall clock relative to its monotonic clock."""
_CLOCK_SAMPLES = 25


class RobotRecorder:
    """Recorder of the samples of `state/joints`, `state/setpoint` and `sensor/pose`.

    Pose stamps are on the robot's wall clock, which may be set at any time. All times here are on
    its monotonic clock; messages on `state/*` carry both stamps, which give the offset.
    """

    def __init__(self, robot: SingularityDescription) -> None:
        self._modules = robot.drive.modules
        joints = robot.kinematics().joints
        self._names = [joint.name for joint in joints]
        self._measures_spin = robot.measures_spin
        self._nominal_v = robot.battery.nominal_v
        self._joints: list[tuple[float, Array]] = []
        self._commanded: list[tuple[float, Array]] = []
        self._poses: list[tuple[float, Array]] = []
        self._clock_offsets_s: list[float] = []
        self.refused = ""
        """Reason for the last rejected pose."""

    def add_joints(self, sample: Sample) -> None:
        """Add measured joints; skip malformed or incomplete samples."""
        found = self._row(sample)
        if found is None:
            return
        now_s, stamp_ns, row = found
        angles = row.reshape(-1, 3)[:, :2]
        if np.isfinite(angles).all() and (not self._joints or now_s > self._joints[-1][0]):
            self._joints.append((now_s, row))
            self._clock_offsets_s.append(stamp_ns * 1e-9 - now_s)

    def add_setpoint(self, sample: Sample) -> None:
        """Add commanded joints."""
        found = self._row(sample)
        if found is not None and np.isfinite(found[2][2::3]).all():
            self._commanded.append((found[0], found[2][2::3]))

    def add_pose(self, sample: Sample) -> tuple[SE2, float] | None:
        """Add a camera pose; return it with its time, or None if it is rejected."""
        try:
            pose, stamp_ns = decode_pose_measurement(sample)
        except MessageError as error:
            self.refused = str(error)
            return None
        if not self._joints:
            return None  # The clock offset is not known yet.
        seen_s = stamp_ns * 1e-9 - float(np.median(self._clock_offsets_s[-_CLOCK_SAMPLES:]))
        off_s = seen_s - self._joints[-1][0]
        if not -_MAX_POSE_AGE_S <= off_s <= _MAX_POSE_LEAD_S:
            self.refused = f"its stamp is {off_s:.1f} s off the clock of the robot"
            return None
        self._poses.append((seen_s, pose.xy_heading))
        return pose, seen_s

    def recording(self, first_s: float, last_s: float, battery_v: float | None) -> Recording:
        """Return the recording between two times; `battery_v` is the voltage, if known.

        Raises:
            TwinError: If there are too few samples, or the robot's wall clock was set during the
                recording.
        """
        joints = [(t_s, row) for t_s, row in self._joints if first_s <= t_s <= last_s]
        poses = sorted(
            [(t_s, pose) for t_s, pose in self._poses if first_s <= t_s <= last_s],
            key=lambda each: each[0],
        )
        ahead = np.array(self._clock_offsets_s)
        if len(joints) < 2 or len(poses) < 2 or not self._commanded:
            raise TwinError("too few samples of the drive have arrived to record it")
        if (
            abs(np.median(ahead[:_CLOCK_SAMPLES]) - np.median(ahead[-_CLOCK_SAMPLES:]))
            > _MAX_CLOCK_JUMP_S
        ):
            raise TwinError("the clock of the robot was set during the drive: drive again")
        t_s, rows = _times_and_rows(joints)
        share = 1.0 if battery_v is None else battery_v / self._nominal_v
        commanded_s, commanded = _times_and_rows(self._commanded)
        last = np.clip(np.searchsorted(commanded_s, t_s, side="right") - 1, 0, None)
        spin = rows[:, 2::3] if self._measures_spin else np.full((len(t_s), self._modules), np.nan)
        angles = rows.reshape(len(rows), -1, 3)[:, :, :2].reshape(len(rows), -1)
        seen_s, seen = _times_and_rows(poses)
        seen[:, 2] = np.unwrap(seen[:, 2])
        return Recording(t_s - t_s[0], angles, share * commanded[last], spin, seen_s - t_s[0], seen)

    def _row(self, sample: Sample) -> tuple[float, int, Array] | None:
        """Return the robot's time, its wall clock, and angles and speeds (n,) of all joints."""
        try:
            _, robot_ns = decode_stamp(sample.attachment)
            state = decode_joints(sample.payload)
            at = [list(state.names).index(name) for name in self._names]
        except (MessageError, ValueError):
            return None
        row = np.array(state.position_rad)[at]
        row[2::3] = np.array(state.velocity_rad_per_s)[at][2::3]
        return robot_ns * 1e-9, state.stamp_ns, row


def _times_and_rows(rows: Sequence[tuple[float, Array]]) -> tuple[Array, Array]:
    return np.array([t_s for t_s, _ in rows]), np.array([row for _, row in rows])
