"""Input log of a robot's controller: all its calls, in order, as published on `log/inputs`.

With it the controller can be run again, bit for bit: period times, measurements, samples as they
came from the bus, requests, and drawn lease ids. What the controller returned is in it too.
"""

from __future__ import annotations

from typing import TypeAlias

import msgspec

from tsd_twin.errors import MessageError
from tsd_twin.messages.commands import Sample


class LeaseDrawn(msgspec.Struct, frozen=True, array_like=True, tag="lease"):
    """A lease id was drawn, during the call that follows."""

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
    fault: str
    setpoint: bytes = b""
    """(n,): what it returned."""
    estimate: bytes = b""
    """Pose, (3,) or of a sphere (4,), and twist (3,), afterwards."""
    others: int = 0
    """CRC-32 of the covariances of pose and twist, and of the second estimate if there is one."""


class StatusCall(msgspec.Struct, frozen=True, array_like=True, tag="status"):
    """`RobotController.status`; the timing of the loop and the hardware only pass through it."""

    now_s: float
    mode: str = ""
    """The mode in it."""


class SentCall(msgspec.Struct, frozen=True, array_like=True, tag="sent"):
    """`RobotController.record_status_sent`."""

    seq: int
    now_s: float


Call: TypeAlias = LeaseDrawn | StopCall | ServeCall | PosesCall | StepCall | StatusCall | SentCall


class Snapshot(msgspec.Struct, frozen=True):
    """State of a controller between two calls, so that a log can be read from its middle."""

    build: str
    """Digest of the code that ran; other code may not understand the state."""
    state: bytes
    """As `tsd_twin.control.logged_controller` writes it."""
    leases: list[bytes]
    """Lease ids that the state may contain."""


class InputBatch(msgspec.Struct, frozen=True):
    """One message on `log/inputs`."""

    first: int
    """Number of the first call: those of the next batch follow without a gap."""
    calls: list[Call]
    snapshot: Snapshot | None = None
    """State before the first call, now and then."""
    pose: list[float] | None = None
    """Initial pose of the controller, (x, y, heading) or a quaternion, w first, in the batch whose
    `first` is 0; None for the default."""


_ENCODER = msgspec.msgpack.Encoder()
_DECODER = msgspec.msgpack.Decoder(InputBatch)


def encode_batch(batch: InputBatch) -> bytes:
    """Return the MessagePack of a batch."""
    return _ENCODER.encode(batch)


def decode_batch(payload: bytes) -> InputBatch:
    """Return the batch in a payload.

    Raises:
        MessageError: `shape`, when this is none.
    """
    try:
        return _DECODER.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError("shape", f"not an input log: {error}") from error
