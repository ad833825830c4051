"""Pictures of cameras: CompressedImage and CameraInfo of ROS 2, and their keys.

A camera publishes JPEG on `twin/<robot>/camera/<name>` or `floor/<name>`, its `CameraInfo` on
`<key>/info`, and holds a liveliness token on `<key>/alive`. A calibrated camera above the floor
publishes a `GroundGrid` on `<key>/ground`, as JSON. Queries on `<key>/clock` return the time of the
clock that stamps its pictures.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import msgspec
import numpy as np

from tsd_twin.errors import BusError
from tsd_twin.lie import Array
from tsd_twin.messages.cdr_codec import CdrReader, CdrWriter
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.topics import checked

IMAGE_TYPE = "sensor_msgs/msg/CompressedImage"
INFO_TYPE = "sensor_msgs/msg/CameraInfo"
LARGEST_PICTURE = 60_000
"""Most bytes of a JPEG: a robot with access rules reassembles messages up to 65,536."""
_ENVELOPE = 512
"""Room for header and format in addition to the JPEG."""


@dataclass(frozen=True, slots=True)
class CompressedImage:
    """Compressed picture; `stamp_ns` is the middle of its exposure on the wall clock."""

    frame: str
    data: bytes
    stamp_ns: int
    format: str = "jpeg"


@dataclass(frozen=True, slots=True, eq=False)
class CameraInfo:
    """Size in pixels, camera matrix (3, 3) and distortion (k1, k2, p1, p2, k3) of a camera."""

    frame: str
    width: int
    height: int
    matrix: Array
    distortion: Array
    stamp_ns: int = 0


def encode_picture(message: CompressedImage) -> bytes:
    """Encode a `sensor_msgs/msg/CompressedImage` as CDR."""
    cdr = CdrWriter()
    cdr.header(message.stamp_ns, message.frame)
    cdr.text(message.format)
    cdr.raw(message.data)
    return cdr.payload()


def decode_picture(payload: bytes) -> CompressedImage:
    """Decode a picture from CDR, without decoding the JPEG.

    Raises:
        MessageError: If it is not a `sensor_msgs/msg/CompressedImage` with JPEG, or too large
            (`shape`).
    """
    cdr = CdrReader(payload, IMAGE_TYPE, LARGEST_PICTURE + _ENVELOPE)
    stamp_ns, frame = cdr.header()
    kind, data = cdr.text(), cdr.raw()
    cdr.end()
    if "jpeg" not in kind or not data.startswith(b"\xff\xd8"):
        raise MessageError("shape", f"pictures are JPEG, not '{kind[:32]}'")
    return CompressedImage(frame, data, stamp_ns)


def encode_camera_info(message: CameraInfo) -> bytes:
    """Encode a `sensor_msgs/msg/CameraInfo` as CDR."""
    matrix = np.asarray(message.matrix, float)
    cdr = CdrWriter()
    cdr.header(message.stamp_ns, message.frame)
    cdr.unsigned(message.height, message.width)
    cdr.text("plumb_bob")
    cdr.double_sequence(np.asarray(message.distortion, float))
    cdr.doubles(matrix.ravel())
    cdr.doubles(np.eye(3).ravel())  # Rectification: none.
    cdr.doubles(np.column_stack([matrix, np.zeros(3)]).ravel())
    cdr.unsigned(0, 0, 0, 0, 0, 0)  # Binning and region of interest: the whole picture.
    cdr.boolean(False)
    return cdr.payload()


def encode_clock(time_ns: int) -> bytes:
    """Encode the time of a camera's clock as JSON."""
    return msgspec.json.encode(time_ns)


def decode_clock(payload: bytes) -> int:
    """Decode the time of a camera's clock, in nanoseconds since 1970.

    Raises:
        MessageError: If it is not a number of 64 bits (`shape`).
    """
    try:
        return _CLOCK.decode(payload)
    except msgspec.MsgspecError as error:
        raise MessageError("shape", f"it is not the time of a clock: {error}") from error


_CLOCK = msgspec.json.Decoder(Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)])

UNKNOWN_PLACE = -10.0
"""Place of a point behind the camera or far outside its picture."""


class GroundGrid(msgspec.Struct, frozen=True):
    """Pixels of a regular grid of floor points, for drawing a picture on the floor.

    Rows have increasing y, columns increasing x of the floor frame, which is `odom`.
    """

    corner_m: tuple[float, float]
    """Least x and y."""
    size_m: tuple[float, float]
    places: list[list[tuple[float, float]]]
    """Fractions of width and height of the picture from its upper left corner; `UNKNOWN_PLACE` for
    points that the camera cannot show."""


def encode_ground(grid: GroundGrid) -> bytes:
    """Encode a grid as JSON."""
    return msgspec.json.encode(grid)


def decode_ground(payload: bytes) -> GroundGrid:
    """Decode a grid from JSON.

    Raises:
        MessageError: If it is not a grid of 2 to 33 points a side and 0.1 to 50 m (`shape`).
    """
    try:
        grid = _GROUND.decode(payload)
    except msgspec.MsgspecError as error:
        raise MessageError("shape", f"it is no grid of the floor: {error}") from error
    rows = {len(row) for row in grid.places}
    numbers = [*grid.corner_m, *(n for row in grid.places for place in row for n in place)]
    if not (
        2 <= len(grid.places) <= _MOST_POINTS
        and len(rows) == 1
        and 2 <= rows.pop() <= _MOST_POINTS
        and all(_LEAST_GROUND_M <= side <= _MOST_GROUND_M for side in grid.size_m)
        and all(math.isfinite(n) and abs(n) <= _FARTHEST for n in numbers)
    ):
        raise MessageError("shape", "a grid of the floor has 2 to 33 points a side")
    return grid


_GROUND = msgspec.json.Decoder(GroundGrid)
_MOST_POINTS, _LEAST_GROUND_M, _MOST_GROUND_M, _FARTHEST = 33, 0.1, 50.0, 1000.0


@dataclass(frozen=True, slots=True)
class CameraName:
    """Identity of a camera: its name, and the robot that carries it, or None above the floor."""

    name: str
    robot: str | None = None

    @property
    def key(self) -> str:
        """Key of its pictures."""
        own = checked(self.name)
        return f"twin/{checked(self.robot)}/camera/{own}" if self.robot else f"floor/{own}"

    @property
    def info_key(self) -> str:
        """Key of its `CameraInfo`."""
        return f"{self.key}/info"

    @property
    def ground_key(self) -> str:
        """Key of its `GroundGrid`."""
        return f"{self.key}/ground"

    @property
    def clock_key(self) -> str:
        """Key on which it answers with the time of its clock."""
        return f"{self.key}/clock"

    @property
    def alive_key(self) -> str:
        """Key of its liveliness token."""
        return f"{self.key}/alive"

    @staticmethod
    def of(key: str) -> CameraName | None:
        """Return the camera with a key or one of the keys below it; None for any other key."""
        match key.split("/"):
            case ["floor", name, *_]:
                found = CameraName(name)
            case ["twin", robot, "camera", name, *_]:
                found = CameraName(name, robot)
            case _:
                return None
        try:
            checked(found.name)
            checked(found.robot or "floor")
        except BusError:
            return None
        return found


GROUND_KEYS = "floor/*/ground"
"""Keys of the grids of all cameras above the floor."""
ALIVE_KEYS = "twin/*/camera/*/alive", "floor/*/alive"
"""Keys of the liveliness tokens of all cameras."""
