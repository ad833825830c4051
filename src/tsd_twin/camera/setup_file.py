"""Camera file in TOML: lens, place, tags and their errors; `tsd-camera calibrate` writes it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from tsd_twin.camera.lens import LENS_PARAMETERS, PARAMETERS, CameraPlace, Lens, View
from tsd_twin.camera.planar_fit import MountingErrors
from tsd_twin.camera.tags import DEFAULT_FAMILY, Tag, cells
from tsd_twin.errors import TwinError
from tsd_twin.lie import Array
from tsd_twin.messages.topics import checked

_Positive = Annotated[float, msgspec.Meta(gt=0.0)]
_NotNegative = Annotated[float, msgspec.Meta(ge=0.0)]


class TagTable(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """`[[tags]]`: a tag on a robot, or, without `robot`, on the floor."""

    number: int
    size_m: _Positive
    robot: str | None = None
    height_m: float = 0.0
    x_m: float = 0.0
    y_m: float = 0.0
    heading_deg: float = 0.0
    family: str = DEFAULT_FAMILY

    def tag(self) -> Tag:
        """Return the tag.

        Raises:
            TwinError: If the family has no such number, or the robot's id is invalid.
        """
        cells(self.family, self.number)
        if self.robot is not None:
            checked(self.robot)
        heading = math.radians(self.heading_deg)
        place = self.height_m, self.x_m, self.y_m, heading
        return Tag(self.number, self.size_m, self.robot, *place, self.family)

    @staticmethod
    def of(tag: Tag) -> TagTable:
        """Return the table of a tag."""
        place = tag.height_m, tag.x_m, tag.y_m, math.degrees(tag.heading_rad)
        return TagTable(tag.number, tag.size_m, tag.robot, *place, tag.family)


class LensTable(msgspec.Struct, forbid_unknown_fields=True):
    """`[lens]`: size of the picture, and fx, fy, cx, cy, k1, k2, p1, p2."""

    width: Annotated[int, msgspec.Meta(gt=0, le=10_000)]
    height: Annotated[int, msgspec.Meta(gt=0, le=10_000)]
    parameters: list[float]


class PlaceTable(msgspec.Struct, forbid_unknown_fields=True):
    """`[place]`: rotation vector from floor to camera, and the camera in the floor frame."""

    rotation: list[float]
    position_m: list[float]


class ErrorTable(msgspec.Struct, forbid_unknown_fields=True):
    """`[errors]`: standard deviations of constant errors of the tags on robots."""

    height_m: _NotNegative = 0.003
    tilt_deg: _NotNegative = 0.5
    place_m: _NotNegative = 0.001
    heading_deg: _NotNegative = 0.2

    def errors(self) -> MountingErrors:
        """Return the errors."""
        return MountingErrors(
            self.height_m, math.radians(self.tilt_deg), self.place_m, math.radians(self.heading_deg)
        )


class _File(msgspec.Struct, forbid_unknown_fields=True):
    lens: LensTable
    place: PlaceTable | None = None
    tags: list[TagTable] = msgspec.field(default_factory=list[TagTable])
    errors: ErrorTable = msgspec.field(default_factory=ErrorTable)
    exposure_s: _NotNegative = 0.0
    delay_s: _NotNegative = 0.0
    covariance: list[list[float]] | None = None
    """For the parameters of the lens, rotation and position."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraSetup:
    """Parameters of a camera and of the tags that it may see."""

    lens: Lens
    place: CameraPlace | None = None
    """None until the floor has been calibrated."""
    covariance: Array = field(default_factory=lambda: np.zeros((PARAMETERS, PARAMETERS)))
    """(14, 14): for the parameters of lens and place."""
    tags: tuple[Tag, ...] = ()
    errors: MountingErrors = field(default_factory=MountingErrors)
    exposure_s: float = 0.0
    """0 if unknown."""
    delay_s: float = 0.0
    """From the middle of an exposure to the picture in the program."""

    @property
    def view(self) -> View:
        """Lens and place.

        Raises:
            TwinError: If the floor has not been calibrated.
        """
        if self.place is None:
            raise TwinError("this camera has no place yet: tsd-camera calibrate floor finds it")
        return View(self.lens, self.place)


def read_setup(path: str | Path) -> CameraSetup:
    """Read a camera file.

    Raises:
        TwinError: If it cannot be read, or a key is unknown, missing or impossible.
    """
    try:
        file = msgspec.toml.decode(Path(path).read_bytes(), type=_File)
        lens = file.lens
        parameters = _numbers(lens.parameters, (LENS_PARAMETERS,), "lens.parameters")
        if not (parameters[:2] > 0.0).all():
            raise TwinError("lens.parameters: fx and fy are greater than 0")
        place, covariance = None, np.zeros((PARAMETERS, PARAMETERS))
        if file.place is not None:
            rotation = _numbers(file.place.rotation, (3,), "place.rotation")
            place = CameraPlace(rotation, _numbers(file.place.position_m, (3,), "place.position_m"))
        if file.covariance is not None:
            covariance = _numbers(file.covariance, (PARAMETERS, PARAMETERS), "covariance")
        return CameraSetup(
            Lens(lens.width, lens.height, parameters),
            place,
            covariance,
            tuple(table.tag() for table in file.tags),
            file.errors.errors(),
            file.exposure_s,
            file.delay_s,
        )
    except (OSError, ValueError, TwinError) as error:
        raise TwinError(f"{path}: {error}") from error


def write_setup(path: str | Path, setup: CameraSetup) -> None:
    """Write a camera file.

    Raises:
        TwinError: If the file cannot be written.
    """
    lens = setup.lens
    lines = ["# Camera of tsd-camera: docs/camera.md.", f"exposure_s = {setup.exposure_s:.9g}"]
    lines += [f"delay_s = {setup.delay_s:.9g}", "", "# Of lens, rotation and position."]
    lines += ["covariance = [", *(f"  {_row(row)}," for row in setup.covariance), "]"]
    lines += ["", "[lens]"]
    lines += [f"width = {lens.width}", f"height = {lens.height}"]
    lines += [f"parameters = {_row(lens.parameters)} # fx, fy, cx, cy, k1, k2, p1, p2"]
    if setup.place is not None:
        lines += ["", "[place]", f"rotation = {_row(setup.place.rotation)} # From floor to camera."]
        lines += [f"position_m = {_row(setup.place.position_m)}"]
    errors = setup.errors
    lines += ["", "[errors]", f"height_m = {errors.height_m:.9g}"]
    lines += [f"tilt_deg = {math.degrees(errors.tilt_rad):.9g}", f"place_m = {errors.place_m:.9g}"]
    lines += [f"heading_deg = {math.degrees(errors.heading_rad):.9g}"]
    for tag in setup.tags:
        table = msgspec.to_builtins(TagTable.of(tag))
        lines += ["", "[[tags]]"]
        lines += [
            f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {value!r}"
            for key, value in table.items()
        ]
    try:
        Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise TwinError(f"{path} cannot be written: {error}") from error


def _numbers(values: list[float] | list[list[float]], shape: tuple[int, ...], key: str) -> Array:
    try:
        found = np.array(values, float)
    except ValueError:
        found = np.empty(0)
    if found.shape != shape or not np.isfinite(found).all():
        raise TwinError(f"{key}: not {' x '.join(map(str, shape))} finite numbers")
    return found


def _row(values: Array) -> str:
    return f"[{', '.join(f'{value:.9g}' for value in values)}]"
