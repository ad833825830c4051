"""Where the parts of a robot go: the few dimensions that more than one drawing needs."""

from __future__ import annotations

import math
from dataclasses import dataclass

from manifold3d import CrossSection, Manifold

from tsd_twin.errors import RobotFileError
from tsd_twin.robots import SingularityRobot

NOMINAL_WHEEL = 40.0
"""Wheel radius that modules are drawn for; other sizes are the same drawing, scaled."""
NOMINAL_SERVO = (40.2, 61.1, 41.0)
"""Width, length and depth of the largest servo that a module has room for; an MX-64."""
RIB_IN, RIB_OUT = 63.0, 60.0
"""Distances of the ribs that carry a module, inboard and outboard, from its pivot; nominal."""
HORN = 0.295
"""Distance of a servo's shaft from the near end of its case, as a share of the length."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Millimetres in the frame `base_link`, whose origin is as high as the gimbal centres."""

    azimuths_deg: tuple[float, ...]
    """Of the modules, in the order of the description."""
    pivot: float
    """Radius that the pivots are on."""
    wheel: float
    """Radius of the wheels: the floor is this far below the origin."""
    servo: tuple[float, float, float]
    """Width, length, depth of a servo, drawn smaller than it is where there is no room for it."""
    plate: float
    """Thickness of the acrylic."""
    floor: float
    """Height of the underside of the lower deck."""
    roof: float
    """Height of the underside of the upper deck."""

    @classmethod
    def of(cls, robot: SingularityRobot) -> Layout:
        """Lay out a robot.

        Raises:
            RobotFileError: the body has no room for the modules, or the wheels none for the plate.
        """
        drive, body = robot.drive, robot.body
        pivot, wheel = 1e3 * drive.pivot_radius_m, 1e3 * drive.wheel_radius_m
        plate = 1e3 * body.plate_thickness_m
        scale = wheel / NOMINAL_WHEEL
        room = pivot - RIB_IN * scale - plate
        if room < 0.2 * wheel:
            least = 1e-3 * (RIB_IN * scale + plate + 0.2 * wheel)
            raise RobotFileError(
                robot.name,
                f"drive.pivot_radius_m is {drive.pivot_radius_m:g}, too little for a body "
                f"with wheels of {drive.wheel_radius_m:g} m",
                f"at least {least:.3f}",
            )
        size = [1e3 * side for side in robot.servo.size_m]
        # Neighbouring servos are boxes on the sides of a polygon: their far corners must not meet.
        slope = math.tan(math.radians(_half_gap_deg(drive.azimuths_deg)))
        fit = room * slope / ((1.0 - HORN) * size[1] + slope * size[2])
        fits = [scale * most / side for most, side in zip(NOMINAL_SERVO, size, strict=True)]
        width, length, depth = (min(1.0, fit, *fits) * side for side in size)
        clearance = min(1e3 * body.ground_clearance_m, wheel - plate - 0.5 * width - 0.5)
        if clearance < 0.05 * wheel:
            raise RobotFileError(
                robot.name,
                f"body.plate_thickness_m is {body.plate_thickness_m:g}, too much for wheels of "
                f"{drive.wheel_radius_m:g} m",
            )
        return cls(
            azimuths_deg=tuple(drive.azimuths_deg),
            pivot=pivot,
            wheel=wheel,
            servo=(width, length, depth),
            plate=plate,
            floor=clearance - wheel,
            roof=0.5 * width + 1.5,
        )

    @property
    def scale(self) -> float:
        """Of wheels and gimbal frames against their drawing."""
        return self.wheel / NOMINAL_WHEEL

    @property
    def deck(self) -> float:
        """Height of the upper side of the lower deck."""
        return self.floor + self.plate

    @property
    def top(self) -> float:
        """Height of the upper side of the upper deck."""
        return self.roof + self.plate

    @property
    def core(self) -> float:
        """Radius of what is free in the middle, between the servos."""
        return self.pivot - RIB_IN * self.scale - self.plate - self.servo[2]

    @property
    def half_gap_deg(self) -> float:
        """Half of the smallest angle between neighbouring modules, at most 75 degrees."""
        return _half_gap_deg(self.azimuths_deg)

    @property
    def lobes_deg(self) -> tuple[float, ...]:
        """Directions half-way between neighbouring modules, one after each module."""
        return tuple(a + 0.5 * gap for a, gap in _gaps_deg(self.azimuths_deg))

    def in_base(self, solid: Manifold, azimuth_deg: float) -> Manifold:
        """Return a `solid` drawn in a module frame, in `base_link`."""
        return solid.translate((0.0, self.pivot, 0.0)).rotate((0.0, 0.0, azimuth_deg - 90.0))

    def outline_in_base(self, outline: CrossSection, azimuth_deg: float) -> CrossSection:
        """Return an `outline` drawn in a module frame, in `base_link`."""
        return outline.translate((0.0, self.pivot)).rotate(azimuth_deg - 90.0)


def _gaps_deg(azimuths_deg: list[float] | tuple[float, ...]) -> list[tuple[float, float]]:
    """Return each azimuth, sorted, and the angle to the next."""
    turned = sorted(a % 360.0 for a in azimuths_deg)
    after = [*turned[1:], turned[0] + 360.0]
    return [(a, b - a) for a, b in zip(turned, after, strict=True)]


def _half_gap_deg(azimuths_deg: list[float] | tuple[float, ...]) -> float:
    return min(75.0, *(0.5 * gap for _, gap in _gaps_deg(azimuths_deg)))
