"""Rerun: the current controller on recorded inputs, compared with the recorded outputs."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import msgspec
import numpy as np

from tsd_twin import robots
from tsd_twin.control import RobotController
from tsd_twin.control.logged_controller import (
    Call,
    InputBatch,
    LeaseDrawn,
    PosesCall,
    SentCall,
    ServeCall,
    StatusCall,
    StepCall,
    StopCall,
    decode_batch,
    estimate_numbers,
    load_state,
)
from tsd_twin.errors import RecordingError
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import SE2, SO3, Array, wrap
from tsd_twin.messages import topics
from tsd_twin.messages.codes import Reason, hardware_reason
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.pose import decode_pose_measurement
from tsd_twin.messages.sentences import sentence
from tsd_twin.messages.services import LeaseReply, Reply
from tsd_twin.messages.status import LoopStatus
from tsd_twin.messages.topics import Service
from tsd_twin.recording import mcap_file
from tsd_twin.recording.data import Recording
from tsd_twin.robots import RobotDescription

Stretch: TypeAlias = Sequence[InputBatch]
"""Contiguous part of an input log."""


@dataclass(frozen=True, slots=True)
class Difference:
    """First difference between the recorded run and the rerun."""

    t_s: float
    """Time since the first step."""
    robot_s: float
    """Robot's monotonic clock."""
    what: str
    """Description of the difference, with both values."""
    cause: str
    """Controller inputs in this step, and its mode."""

    def __str__(self) -> str:
        return f"at {self.t_s:.3f} s (robot clock {self.robot_s:.3f} s) {self.what}; {self.cause}"


@dataclass(slots=True)
class RerunResult:
    """Recorded and rerun outputs of the controller for one contiguous part."""

    robot: RobotDescription
    t_s: list[float] = field(default_factory=list[float])
    recorded: list[Array] = field(default_factory=list[Array])
    """Joint setpoints (n,) per step."""
    setpoints: list[Array] = field(default_factory=list[Array])
    recorded_estimates: list[Array] = field(default_factory=list[Array])
    """Pose (3,), or quaternion (4,) for a sphere, and twist (3,)."""
    estimates: list[Array] = field(default_factory=list[Array])
    odometry: list[Array] = field(default_factory=list[Array])
    """Pose (3,) or quaternion (4,) by dead reckoning, without pose sensor, per step."""
    sensed: list[tuple[float, Array]] = field(default_factory=list[tuple[float, Array]])
    """Poses (3,) of the pose sensor, with their time since the first step."""
    difference: Difference | None = None

    def sensed_motion(self) -> tuple[Array, Array] | None:
        """Return the motion (3,) by the pose sensor, and by dead reckoning at the same times.

        Both are from start to end of the poses of the sensor, in the axes of the robot at the
        start. Poses before the first and after the last motion are averaged. None without poses of
        two times.
        """
        if len(self.sensed) < 2 or len(self.odometry[0]) != 3:
            return None
        last = len(self.t_s) - 1
        at = np.searchsorted(self.t_s, [t_s for t_s, _ in self.sensed]).clip(0, last)
        reckoned, sensed = np.array(self.odometry)[at], np.array([pose for _, pose in self.sensed])
        start, end = (_near(reckoned, reckoned[i]) for i in (0, -1))
        by_sensor, by_joints = (
            (_mean(poses[start]).inverse() @ _mean(poses[end])).xy_heading
            for poses in (sensed, reckoned)
        )
        return by_sensor, by_joints

    def largest_setpoint_difference(self, kind: JointKind) -> tuple[float, int, int] | None:
        """Return the largest difference of joints of a kind, with its step and joint.

        It is in rad for position joints and rad/s for velocity joints; None if nothing differs.
        """
        apart = np.nan_to_num(np.abs(np.array(self.setpoints) - np.array(self.recorded)))
        apart *= [joint.kind is kind for joint in self.robot.kinematics().joints]
        step, joint = np.unravel_index(int(np.argmax(apart)), apart.shape)
        largest = float(apart[step, joint])
        return (largest, int(step), int(joint)) if largest > 0.0 else None

    @property
    def largest_difference(self) -> float:
        """Largest absolute difference of setpoints and estimates, in rad, m and their rates."""
        pairs = ((self.recorded, self.setpoints), (self.recorded_estimates, self.estimates))
        return max(
            (float(np.nanmax(np.abs(np.array(a) - np.array(b)), initial=0.0)) for a, b in pairs),
            default=0.0,
        )


_STILL = np.array([0.005, 0.005, 0.02])
"""Distance of poses (m, m, rad) within which the robot counts as at the same place."""


def _near(poses: Array, pose: Array) -> list[int]:
    """Return the indices of the poses (n, 3) at the same place as `pose` (3,)."""
    return np.flatnonzero((np.abs(wrapped(poses - pose)) <= _STILL).all(axis=1)).tolist()


def _mean(poses: Array) -> SE2:
    """Return the mean of poses (n, 3) that are near each other."""
    return SE2(poses[0] + wrapped(poses - poses[0]).mean(axis=0))


def wrapped(differences: Array) -> Array:
    """Return differences (..., 3) of poses with the heading in (-pi, pi]."""
    return np.concatenate([differences[..., :2], wrap(differences[..., 2:])], axis=-1)


def stretches(batches: Iterable[InputBatch]) -> list[list[InputBatch]]:
    """Split an input log into contiguous parts that start with a controller state."""
    found: list[list[InputBatch]] = []
    following: int | None = None
    for batch in batches:
        if batch.first != following:
            following = None
            if batch.first == 0 or batch.snapshot is not None:
                found.append([])
                following = batch.first
        if following is not None:
            found[-1].append(batch)
            following += len(batch.calls)
    return found


def recorded_batches(recording: Recording, robot: str) -> Iterator[InputBatch]:
    """Yield the input log of a robot.

    Raises:
        RecordingError: If the file has no input log, or it is damaged.
    """
    key = topics.INPUTS.key(robot)
    if key not in recording.topics:
        raise RecordingError(f"{recording.path} has no input log of {robot}")
    for entry in mcap_file.entries(recording.path, {key}):
        try:
            yield decode_batch(entry.data)
        except MessageError as error:
            raise RecordingError(f"{recording.path}: {error}") from error


class Rerun:
    """Feeds recorded calls to a controller and compares its outputs."""

    def __init__(self, stretch: Stretch, description: str, tolerance: float = 0.0) -> None:
        """Load the controller.

        Args:
            stretch: Calls to run.
            description: Recorded robot description (TOML).
            tolerance: Allowed difference of numbers; 0 compares bit for bit.

        Raises:
            TwinError: If this code cannot read the recorded controller state.
        """
        self._stretch, self._tolerance = stretch, tolerance
        self._leases: deque[bytes] = deque()
        self._unknown = itertools.count(1)
        first = stretch[0]
        if first.first == 0:
            robot = robots.parse_description(description, "the recorded description")
            pose = None if first.pose is None else initial_pose(first.pose)
            self.controller = RobotController(robot, self._lease, pose=pose)
        else:
            assert first.snapshot is not None  # noqa: S101  A stretch begins with one.
            self.controller = load_state(first.snapshot.state, self._lease)
        self._result = RerunResult(self.controller.robot)
        self._start_s: float | None = None
        self._requests: list[str] = []

    def run(self) -> RerunResult:
        """Run all calls, up to the first exception."""
        for call in itertools.chain.from_iterable(batch.calls for batch in self._stretch):
            try:
                self._run(call)
            except Exception as error:  # Any exception of the code under test is a difference.
                now_s = getattr(call, "now_s", math.nan)
                self._differs(now_s, f"the controller raises {type(error).__name__}: {error}", call)
                break
        return self._result

    def _lease(self) -> bytes:
        # If the code draws an unrecorded lease, its different id appears in the reply.
        return self._leases.popleft() if self._leases else next(self._unknown).to_bytes(16, "big")

    def _run(self, call: Call) -> None:
        controller = self.controller
        match call:
            case LeaseDrawn():
                self._leases.append(call.id)
            case StopCall():
                self._requests.append(Service.STOP)
                reply = controller.stop(call.payload, call.now_s)
                self._compare_replies("the answer to stop", call, reply)
            case ServeCall():
                self._requests.append(call.service)
                answer = controller.serve(Service(call.service), call.payload, call.now_s)
                self._compare_replies(f"the answer to {call.service}", call, answer)
            case PosesCall():
                self._sense(call)
                controller.add_pose_measurements(call.poses, call.now_s, call.wall_ns)
            case StepCall():
                self._step(call)
            case StatusCall():
                status = controller.status(call.now_s, LoopStatus(), {})
                self._compare("the mode", call.mode.encode(), status.mode.encode(), call)
            case SentCall():
                controller.record_status_sent(call.seq, call.now_s)

    def _sense(self, call: PosesCall) -> None:
        """Collect the valid poses of the pose sensor."""
        for sample in call.poses:
            with contextlib.suppress(MessageError):
                pose, stamp_ns = decode_pose_measurement(sample)
                taken_s = call.now_s - 1e-9 * (call.wall_ns - stamp_ns)
                if self._start_s is not None and taken_s >= self._start_s:
                    self._result.sensed.append((taken_s - self._start_s, pose.xy_heading))

    def _inputs(self, call: StepCall) -> tuple[Array | None, Reason | None, float | None]:
        """Return measurement (n + s,), fault and battery voltage for a step: the recorded ones."""
        measured = None if call.measured is None else np.frombuffer(call.measured, "<f8").copy()
        return measured, hardware_reason(call.fault), call.battery_v

    def _step(self, call: StepCall) -> None:
        controller, result = self.controller, self._result
        self._start_s = call.now_s if self._start_s is None else self._start_s
        measured, fault, battery_v = self._inputs(call)
        setpoint = controller.step(
            call.now_s, measured, call.samples, fault, battery_v, call.servo_c
        )
        controller.take_events()
        estimate, others = estimate_numbers(controller)
        recorded = np.frombuffer(call.setpoint, "<f8")
        recorded_estimate, here = (np.frombuffer(each, "<f8") for each in (call.estimate, estimate))
        result.t_s.append(call.now_s - self._start_s)
        result.recorded.append(recorded)
        result.setpoints.append(setpoint.copy())
        result.recorded_estimates.append(recorded_estimate)
        result.estimates.append(here)
        unfused = controller.unfused_pose
        result.odometry.append(
            unfused.xy_heading.copy() if isinstance(unfused, SE2) else unfused.wxyz.copy()
        )
        if result.difference is None:
            names = [joint.name for joint in controller.kinematics.joints]
            self._compare_numbers("the set-point of", names, recorded, setpoint, call)
            parts = _ESTIMATE[len(here)]
            self._compare_numbers("the estimate of", parts, recorded_estimate, here, call)
            if others != call.others and self._tolerance == 0.0:
                what = "the covariance of the estimate, or the second estimate, differs"
                self._differs(call.now_s, what, call)
        self._requests.clear()

    def _compare(self, what: str, recorded: bytes, now: bytes, call: Any) -> None:
        if recorded != now:
            was, here = recorded.decode("utf-8", "replace"), now.decode("utf-8", "replace")
            self._differs(call.now_s, f"{what} was {was} and is {here}", call)

    def _compare_replies(
        self, what: str, call: StopCall | ServeCall, reply: Reply | LeaseReply
    ) -> None:
        """Compare a reply with the recorded one: the codes, or the texts if it has no code."""
        now = msgspec.json.encode(reply)
        recorded, here = _without_texts(call.reply), _without_texts(now)
        if recorded is None or here is None:
            self._compare(what, call.reply, now, call)
            return
        if "why" not in recorded:
            here.pop("why", None)
        if recorded != here:
            self._compare(what, call.reply, now, call)

    def _compare_numbers(
        self, what: str, names: Sequence[str], recorded: Array, now: Array, call: StepCall
    ) -> None:
        if recorded.tobytes() == now.tobytes():
            return
        if len(recorded) != len(now):
            self._differs(
                call.now_s, f"{what} {len(now)} joints: {len(recorded)} are recorded", call
            )
            return
        apart = np.abs(recorded - now)
        apart[np.isnan(recorded) & np.isnan(now)] = 0.0
        if (apart <= self._tolerance).all() and self._tolerance > 0.0:
            return
        # Zeros of different sign differ only in their bits.
        worst = int(np.argmax(np.where(np.isnan(apart), np.inf, apart)))
        values = f"was {recorded[worst]:.12g} and is {now[worst]:.12g}"
        self._differs(call.now_s, f"{what} {names[worst]} {values}", call)

    def _differs(self, now_s: float, what: str, call: Call) -> None:
        if self._result.difference is None:
            start_s = now_s if self._start_s is None else self._start_s
            self._result.difference = Difference(now_s - start_s, now_s, what, self._cause(call))

    def _cause(self, call: Call) -> str:
        given: list[str] = [f"request {name}" for name in self._requests]
        if isinstance(call, StepCall):
            given += [f"{len(call.samples)} commands"] if call.samples else []
            given += ["no measurement"] if call.measured is None else []
            fault = hardware_reason(call.fault)
            given += [] if fault is None else [f"fault '{sentence(fault)}'"]
        supervisor = self.controller.supervisor
        mode = f"mode {supervisor.mode}" + (f" ({supervisor.reason})" if supervisor.reason else "")
        return f"{mode}, given {', '.join(given) or 'measurements only'}"


_TWIST = ["vx", "vy", "omega"]
_ESTIMATE = {
    6: ["x", "y", "heading", *_TWIST],
    7: ["qw", "qx", "qy", "qz", "wx", "wy", "wz"],
}
"""Names of the estimate's components, by their number."""


def initial_pose(numbers: Sequence[float]) -> SE2 | SO3:
    """Return the planar pose or orientation in three or four recorded numbers."""
    return SE2(np.array(numbers)) if len(numbers) == 3 else SO3(np.array(numbers))


def _without_texts(reply: bytes) -> dict[str, Any] | None:
    """Return the fields of a reply except its text, whose wording may change; None if damaged."""
    try:
        fields = msgspec.json.decode(reply, type=dict[str, Any])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    fields.pop("reason", None)
    return fields
