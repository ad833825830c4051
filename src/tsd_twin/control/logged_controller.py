"""Robot controller that logs its inputs, so that its run can be repeated."""

from __future__ import annotations

import zlib
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from tsd_twin.control.robot_controller import RobotController
from tsd_twin.control.snapshot import LeaseIds, dump
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.commands import Sample
from tsd_twin.messages.input_log import (
    Call,
    InputBatch,
    LeaseDrawn,
    PosesCall,
    SentCall,
    ServeCall,
    Snapshot,
    StatusCall,
    StepCall,
    StopCall,
)
from tsd_twin.messages.ros import Odometry
from tsd_twin.messages.services import LeaseReply, Reply
from tsd_twin.messages.status import LoopStatus, Status
from tsd_twin.messages.topics import Service
from tsd_twin.robots import RobotDescription

_LEASES_KEPT = 8
"""Lease ids of the past that a snapshot names: the state refers to fewer."""


class LoggedController(RobotController):
    """Robot controller that logs every call that changes its state, while `logs` is set.

    It does what a `RobotController` does; off, a call costs one test more.
    """

    def __init__(
        self,
        robot: RobotDescription,
        new_lease_id: Callable[[], bytes],
        *,
        pose: SE2 | SO3 | None = None,
        build: str = "",
    ) -> None:
        """`build` is a digest of the code that runs, for snapshots."""
        self._lease_ids = LeaseIds(new_lease_id)
        self._leases: deque[bytes] = deque(maxlen=_LEASES_KEPT)
        self._build = build
        self._pose = None if pose is None else pose_numbers(pose)
        self.logs = True
        self._calls: list[Call] = []
        self._first = 0
        self._snapshot: Snapshot | None = None
        self._own = frozenset({*vars(self), "_own"})
        super().__init__(robot, self._lease_ids, pose=pose)

    def step(
        self, now_s: float, measured: Array | None, samples: Sequence[Sample], fault: str = ""
    ) -> Array:
        """Run one period, as `RobotController.step`."""
        setpoint = super().step(now_s, measured, samples, fault)
        if self.logs:
            estimate, others = estimate_numbers(self)
            raw = None if measured is None else np.asarray(measured, dtype="<f8").tobytes()
            self._calls.append(
                StepCall(now_s, raw, list(samples), fault, setpoint.tobytes(), estimate, others)
            )
        return setpoint

    def add_pose_measurements(self, poses: Sequence[Sample], now_s: float, wall_ns: int) -> None:
        """Queue samples of `sensor/pose`."""
        super().add_pose_measurements(poses, now_s, wall_ns)
        if self.logs:
            self._calls.append(PosesCall(list(poses), now_s, wall_ns))

    def serve(self, service: Service, payload: bytes, now_s: float) -> LeaseReply | Reply:
        """Return the reply to a request."""
        reply = super().serve(service, payload, now_s)
        drawn = self._lease_ids.take()
        self._leases.extend(drawn)
        if self.logs:
            self._calls.extend(map(LeaseDrawn, drawn))
            answer = msgspec.json.encode(reply)
            self._calls.append(ServeCall(service.value, payload, now_s, answer))
        return reply

    def stop(self, payload: bytes, now_s: float) -> Reply:
        """Latch a stop."""
        reply = super().stop(payload, now_s)
        if self.logs:
            self._calls.append(StopCall(payload, now_s, msgspec.json.encode(reply)))
        return reply

    def status(self, now_s: float, loop: LoopStatus, hardware: Mapping[str, Any]) -> Status:
        """Return the message of `state/status`."""
        status = super().status(now_s, loop, hardware)
        if self.logs:
            self._calls.append(StatusCall(now_s, status.mode))
        return status

    def record_status_sent(self, seq: int, now_s: float) -> None:
        """Record the sending time of a status."""
        super().record_status_sent(seq, now_s)
        if self.logs:
            self._calls.append(SentCall(seq, now_s))

    # The log.

    def begin_log(self) -> None:
        """Log from now on; the next batch has the state of now."""
        self.logs, self._snapshot = True, self._state()

    def end_log(self) -> None:
        """Log no longer, and forget what was not taken."""
        self._first += len(self._calls) + 1  # A gap, which a reader notices.
        self.logs, self._calls, self._snapshot = False, [], None

    def take_log(self, *, snapshot: bool = False) -> InputBatch:
        """Return the calls since the last time; with `snapshot`, the next batch has the state."""
        pose = self._pose if self._first == 0 else None
        batch = InputBatch(self._first, self._calls, self._snapshot, pose)
        self._first += len(self._calls)
        self._calls, self._snapshot = [], self._state() if snapshot else None
        return batch

    def _state(self) -> Snapshot:
        state = dump(self, self._lease_ids, self._own)
        return Snapshot(self._build, state, list(self._leases))


def pose_numbers(pose: SE2 | SO3) -> list[float]:
    """Return a pose as it is logged: (x, y, heading), or a quaternion, w first."""
    return (pose.xy_heading if isinstance(pose, SE2) else pose.wxyz).tolist()


def estimate_numbers(controller: RobotController) -> tuple[bytes, int]:
    """Return the estimate as it is logged: pose and twist, and a CRC-32 of all else."""
    best, second = controller.odometry(0), controller.alternative_odometry(0)
    others = best.pose_covariance.tobytes() + best.twist_covariance.tobytes()
    if second is not None:
        others += _numbers(second) + second.pose_covariance.tobytes()
    return _numbers(best), zlib.crc32(others)


def _numbers(odometry: Odometry) -> bytes:
    pose = odometry.xy_heading if odometry.wxyz is None else odometry.wxyz
    return pose.tobytes() + odometry.twist.tobytes()
