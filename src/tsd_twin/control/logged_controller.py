"""Robot controller that logs its inputs and snapshots, so that its run can be repeated.

The log on `log/inputs` contains all controller calls in order: period times, measurements, raw bus
samples, requests and new lease ids. It also contains the controller's outputs.

Snapshots are pickled, which is fast enough for the control loop. When reading, only classes
of the packages below are allowed, which have no I/O, and what numpy needs to make arrays: a file
from another person cannot run code.
"""

from __future__ import annotations

import io
import pickle
import zlib
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import msgspec
import numpy as np

from tsd_twin.control.robot_controller import RobotController
from tsd_twin.errors import TwinError
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.cdr import Odometry
from tsd_twin.messages.codes import Reason
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.services import LeaseReply, Reply
from tsd_twin.messages.status import LoopStatus, RobotStatus
from tsd_twin.messages.topics import Sample, Service
from tsd_twin.robots import RobotDescription


class LeaseDrawn(msgspec.Struct, frozen=True, array_like=True, tag="lease"):
    """New lease id, drawn during the next call."""

    id: bytes


class StopCall(msgspec.Struct, frozen=True, array_like=True, tag="stop"):
    """`RobotController.stop`."""

    payload: bytes
    now_s: float
    reply: bytes = b""
    """JSON."""


class ServeCall(msgspec.Struct, frozen=True, array_like=True, tag="serve"):
    """`RobotController.serve`."""

    service: str
    payload: bytes
    now_s: float
    reply: bytes = b""
    """JSON."""


class PosesCall(msgspec.Struct, frozen=True, array_like=True, tag="poses"):
    """`RobotController.add_pose_measurements`."""

    poses: list[Sample]
    now_s: float
    wall_ns: int


class StepCall(msgspec.Struct, frozen=True, array_like=True, tag="step"):
    """`RobotController.step`; arrays are little-endian 64-bit floats."""

    now_s: float
    measured: bytes | None
    samples: list[Sample]
    fault: str | Reason
    """Fault that the board reports; an empty text without one."""
    setpoint: bytes = b""
    """(n,): returned setpoint."""
    estimate: bytes = b""
    """Resulting pose, (3,) or (4,) for a sphere, and twist (3,)."""
    others: int = 0
    """CRC-32 of the covariances of pose and twist, and of the second estimate if any."""
    battery_v: float | None = None
    servo_c: float | None = None


class StatusCall(msgspec.Struct, frozen=True, array_like=True, tag="status"):
    """`RobotController.status`; loop timing and hardware status do not affect the state."""

    now_s: float
    mode: str = ""
    """Mode in the status."""


class SentCall(msgspec.Struct, frozen=True, array_like=True, tag="sent"):
    """`RobotController.record_status_sent`."""

    seq: int
    now_s: float


Call: TypeAlias = LeaseDrawn | StopCall | ServeCall | PosesCall | StepCall | StatusCall | SentCall


class ControllerCheckpoint(msgspec.Struct, frozen=True):
    """State of a controller between two calls, from which a log can be replayed."""

    build: str
    """Digest of the code; other versions may not understand the state."""
    state: bytes
    """State pickled by `tsd_twin.control.logged_controller`."""
    leases: list[bytes]
    """Lease ids that may occur in the state."""


class InputBatch(msgspec.Struct, frozen=True):
    """Message on `log/inputs`."""

    first: int
    """Number of the first call; batches are numbered without gaps."""
    calls: list[Call]
    snapshot: ControllerCheckpoint | None = None
    """State before the first call, included periodically."""
    pose: list[float] | None = None
    """Initial pose in the batch with `first` 0: (x, y, heading) or quaternion (w first), or None
    for the default."""


_ENCODER = msgspec.msgpack.Encoder()
_DECODER = msgspec.msgpack.Decoder(InputBatch)


def encode_batch(batch: InputBatch) -> bytes:
    """Encode a batch as MessagePack."""
    return _ENCODER.encode(batch)


def decode_batch(payload: bytes) -> InputBatch:
    """Decode a batch.

    Raises:
        MessageError: If the payload is invalid (`shape`).
    """
    try:
        return _DECODER.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError("shape", f"not an input log: {error}") from error


PURE = frozenset(
    {
        "control",
        "estimation",
        "kinematics",
        "lie",
        "messages",
        "motion",
        "robots",
        "safety",
        "sensors",
        "tables",
    }
)
"""Packages and modules without I/O: the code of a controller, and the classes of its state."""
_OTHERS = frozenset(
    {
        ("builtins", "complex"),
        ("collections", "OrderedDict"),
        ("collections", "deque"),
        ("msgspec._core", "UNSET"),
        ("msgspec._utils", "rebuild"),
        ("numpy", "dtype"),
        ("numpy", "ndarray"),
        ("numpy._core.multiarray", "_reconstruct"),
        ("numpy._core.multiarray", "scalar"),
        ("numpy._core.numeric", "_frombuffer"),
        ("numpy.core.multiarray", "_reconstruct"),
        ("numpy.core.multiarray", "scalar"),
        ("numpy.core.numeric", "_frombuffer"),
    }
)


class LeaseIds:
    """Source of lease ids that records them; can be pickled in a snapshot."""

    def __init__(self, draw: Callable[[], bytes]) -> None:
        self.draw = draw
        self.drawn: list[bytes] = []

    def __call__(self) -> bytes:
        """Return a new id."""
        lease_id = self.draw()
        self.drawn.append(lease_id)
        return lease_id

    def take(self) -> list[bytes]:
        """Return the ids drawn since the last call."""
        drawn, self.drawn = self.drawn, []
        return drawn

    def __getstate__(self) -> dict[str, object]:
        return {}  # The source is not part of the state; loading sets a new one.


def dump_state(controller: RobotController, lease_ids: LeaseIds, without: frozenset[str]) -> bytes:
    """Pickle the state of a controller that uses `lease_ids`.

    `without` names attributes to omit.
    """
    state = {name: value for name, value in vars(controller).items() if name not in without}
    return pickle.dumps((lease_ids, state), protocol=5)


def load_state(state: bytes, draw: Callable[[], bytes]) -> RobotController:
    """Restore a controller whose new lease ids come from `draw`.

    Raises:
        TwinError: If the data is damaged, has unexpected content or is from a different version.
    """
    try:
        ids, attributes = _SafeUnpickler(io.BytesIO(state)).load()
        ids.draw, ids.drawn = draw, []
        controller = RobotController.__new__(RobotController)
        vars(controller).update(attributes)
        _check_attributes(controller, RobotController(controller.robot, draw))
    except Exception as error:  # Damaged data can raise anything.
        raise TwinError(f"the state of the controller cannot be read: {error}") from error
    return controller


def _check_attributes(restored: object, new: object) -> None:
    """Refuse a state that lacks attributes of this version, in the object or its components."""
    for name, value in vars(new).items():
        if name not in vars(restored):
            raise ValueError(f"it has no {type(new).__name__}.{name} and is of another version")
        component = vars(restored)[name]
        is_component = isinstance(new, RobotController) and hasattr(value, "__dict__")
        if is_component and type(component) is type(value):
            _check_attributes(component, value)


class _SafeUnpickler(pickle.Unpickler):
    """Unpickler restricted to classes without I/O."""

    def find_class(self, module_name: str, global_name: str) -> Any:
        package = module_name.split(".")[:2]
        own = package[0] == "tsd_twin" and len(package) == 2 and package[1] in PURE
        try:
            if (module_name, global_name) in _OTHERS:
                return super().find_class(module_name, global_name)
            if own:
                found = super().find_class(module_name, global_name)
                if isinstance(found, type) and found.__module__ == module_name:
                    return found
        except (ImportError, AttributeError) as error:
            raise pickle.UnpicklingError(
                f"{module_name}.{global_name} is of another version"
            ) from error
        raise pickle.UnpicklingError(f"{module_name}.{global_name} is not part of a state")


_LEASES_KEPT = 8
"""Past lease ids kept in a snapshot; the state refers to fewer."""


class LoggedController(RobotController):
    """Robot controller that logs every state-changing call while `logs` is set.

    Otherwise identical to `RobotController`; without logging, a call costs one extra test.
    """

    def __init__(
        self,
        robot: RobotDescription,
        new_lease_id: Callable[[], bytes],
        *,
        pose: SE2 | SO3 | None = None,
        build: str = "",
    ) -> None:
        """`build` is a digest of the code, for snapshots."""
        self._lease_ids = LeaseIds(new_lease_id)
        self._leases: deque[bytes] = deque(maxlen=_LEASES_KEPT)
        self._build = build
        self._pose = None if pose is None else pose_numbers(pose)
        self.logs = True
        self._calls: list[Call] = []
        self._first = 0
        self._snapshot: ControllerCheckpoint | None = None
        self._own = frozenset({*vars(self), "_own"})
        super().__init__(robot, self._lease_ids, pose=pose)

    def step(
        self,
        now_s: float,
        measured: Array | None,
        samples: Sequence[Sample],
        fault: Reason | None = None,
        battery_v: float | None = None,
        servo_c: float | None = None,
    ) -> Array:
        """Run one period; see `RobotController.step`."""
        setpoint = super().step(now_s, measured, samples, fault, battery_v, servo_c)
        if self.logs:
            estimate, others = estimate_numbers(self)
            raw = None if measured is None else np.asarray(measured, dtype="<f8").tobytes()
            self._calls.append(
                StepCall(
                    now_s,
                    raw,
                    list(samples),
                    fault or "",
                    setpoint.tobytes(),
                    estimate,
                    others,
                    battery_v,
                    servo_c,
                )
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

    def status(self, now_s: float, loop: LoopStatus, hardware: Mapping[str, Any]) -> RobotStatus:
        """Return the message of `state/status`."""
        status = super().status(now_s, loop, hardware)
        if self.logs:
            self._calls.append(StatusCall(now_s, status.mode))
        return status

    def record_status_sent(self, seq: int, now_s: float) -> None:
        """Record the send time of a status."""
        super().record_status_sent(seq, now_s)
        if self.logs:
            self._calls.append(SentCall(seq, now_s))

    # The log.

    def begin_log(self) -> None:
        """Start logging; the next batch contains the current state."""
        self.logs, self._snapshot = True, self._state()

    def end_log(self) -> None:
        """Stop logging and discard pending calls."""
        self._first += len(self._calls) + 1  # A gap that readers detect.
        self.logs, self._calls, self._snapshot = False, [], None

    def take_log(self, *, snapshot: bool = False) -> InputBatch:
        """Return the calls since the last time; with `snapshot`, the next batch has the state."""
        pose = self._pose if self._first == 0 else None
        batch = InputBatch(self._first, self._calls, self._snapshot, pose)
        self._first += len(self._calls)
        self._calls, self._snapshot = [], self._state() if snapshot else None
        return batch

    def _state(self) -> ControllerCheckpoint:
        state = dump_state(self, self._lease_ids, self._own)
        return ControllerCheckpoint(self._build, state, list(self._leases))


def pose_numbers(pose: SE2 | SO3) -> list[float]:
    """Return a pose for the log: (x, y, heading), or a quaternion (w first)."""
    return (pose.xy_heading if isinstance(pose, SE2) else pose.wxyz).tolist()


def estimate_numbers(controller: RobotController) -> tuple[bytes, int]:
    """Return the estimate for the log: pose and twist, and a CRC-32 of the remaining values."""
    best, second = controller.odometry(0), controller.alternative_odometry(0)
    others = best.pose_covariance.tobytes() + best.twist_covariance.tobytes()
    if second is not None:
        others += _numbers(second) + second.pose_covariance.tobytes()
    return _numbers(best), zlib.crc32(others)


def _numbers(odometry: Odometry) -> bytes:
    pose = odometry.xy_heading if odometry.wxyz is None else odometry.wxyz
    return pose.tobytes() + odometry.twist.tobytes()
