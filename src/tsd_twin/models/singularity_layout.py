"""Layout of a singularity drive: shared dimensions, deck outlines, and the servo."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from manifold3d import CrossSection, Manifold

from tsd_twin.errors import RobotFileError
from tsd_twin.models.solids import (
    Point,
    Span,
    box,
    circle,
    gaps_deg,
    halfway_deg,
    rectangle,
    rod,
    slab,
    softened,
    strip_reach,
    union,
)
from tsd_twin.robots import SingularityDescription

NOMINAL_WHEEL = 40.0
"""Wheel radius of the module drawings; other sizes are scaled."""
NOMINAL_SERVO = (40.2, 61.1, 41.0)
"""Width, length and depth of the largest servo that fits a module; an MX-64."""
RIB_IN, RIB_OUT = 63.0, 60.0
"""Nominal distances of a module's inboard and outboard ribs from its pivot."""
HORN = 0.295
"""Distance of a servo's shaft from the near end of its case, relative to the length."""
RIM = 84.0
"""Nominal radius of the deck corners about the pivots."""
_BAY = 63.0
"""Nominal radius of the round bays that the frames enter at full tilt."""
_BAY_SIDES = (-57.0, 55.5)
"""Nominal flat sides of the bays at the ribs, along Y of the module."""
_SWEEP = (-64.0, 88.0)
"""Nominal extent of the outer frame with its servo at full tilt, along X of the module."""
_ABOVE_SWEEP = 31.0
"""Nominal clearance between a deck above the modules and the frames at full tilt."""


@dataclass(frozen=True)
class Layout:
    """Dimensions in millimetres in `base_link`, whose origin is at gimbal height."""

    azimuths_deg: tuple[float, ...]
    """Azimuths of the modules, in description order."""
    radii: tuple[float, ...]
    """Distances of the pivots from the centre."""
    wheel: float
    """Radius of the wheels, and depth of the floor below the origin."""
    servo: tuple[float, float, float]
    """Width, length and depth of a servo, reduced if there is no room."""
    plate: float
    """Thickness of the acrylic."""
    floor: float
    """Height of the underside of the lower deck, if any."""
    roof: float
    """Height of the underside of the upper deck."""

    @classmethod
    def of(cls, robot: SingularityDescription) -> Layout:
        """Lay out a robot; pivots at any positions get a single deck above the moving parts.

        Raises:
            RobotFileError: If modules on a circle do not fit the body, or the plate does not fit
                the wheels.
        """
        drive = robot.drive
        wheel, plate = 1e3 * drive.wheel_radius_m, 1e3 * robot.body.plate_thickness_m
        scale = wheel / NOMINAL_WHEEL
        size = [1e3 * side for side in robot.servo.size_m]
        fits = [scale * most / side for most, side in zip(NOMINAL_SERVO, size, strict=True)]
        if not drive.positions:
            fits.append(_fit_between_modules(robot, size))
        width, length, depth = (min(1.0, *fits) * side for side in size)
        if drive.positions:
            swept = _SWEEP[1] * math.sin(math.radians(drive.max_tilt_deg))
            floor, roof = -wheel, (swept + _ABOVE_SWEEP) * scale
        else:
            floor, roof = _clearance(robot, width) - wheel, 0.5 * width + 1.5
        return cls(
            azimuths_deg=tuple(drive.directions_deg),
            radii=tuple((1e3 * np.broadcast_to(drive.pivot_radii_m, drive.modules)).tolist()),
            wheel=wheel,
            servo=(width, length, depth),
            plate=plate,
            floor=floor,
            roof=roof,
        )

    @property
    def pivot(self) -> float:
        """Radius of the circle through the pivots, if they are on one."""
        return self.radii[0]

    @property
    def scale(self) -> float:
        """Scale of wheels and gimbal frames relative to their drawing."""
        return self.wheel / NOMINAL_WHEEL

    @property
    def deck(self) -> float:
        """Height of the top of the lower deck."""
        return self.floor + self.plate

    @property
    def top(self) -> float:
        """Height of the top of the upper deck."""
        return self.roof + self.plate

    @property
    def core(self) -> float:
        """Radius of the free area in the middle, between the servos."""
        return self.pivot - RIB_IN * self.scale - self.plate - self.servo[2]

    @property
    def lobes_deg(self) -> tuple[float, ...]:
        """Directions midway between neighbouring modules, one after each module."""
        return halfway_deg(self.azimuths_deg)

    def at_modules(self, solid: Manifold) -> Manifold:
        """Copy a `solid` from the module frame to every module, in `base_link`."""
        return union(
            solid.translate((0.0, radius, 0.0)).rotate((0.0, 0.0, azimuth - 90.0))
            for azimuth, radius in zip(self.azimuths_deg, self.radii, strict=True)
        )

    def outline_in_base(self, outline: CrossSection, azimuth_deg: float) -> CrossSection:
        """Move an `outline` from the module frame to `base_link`."""
        return outline.translate((0.0, self.pivot)).rotate(azimuth_deg - 90.0)

    @cached_property
    def outline(self) -> CrossSection:
        """Outline of both decks: a polygon with round corners."""
        m = self.scale
        corners = [self.outline_in_base(circle(RIM * m), a) for a in self.azimuths_deg]
        # A triangle suffices for three modules; two or unevenly spaced modules need a middle too.
        return CrossSection.batch_hull([*corners, circle(self.pivot - 20.0 * m)])

    @property
    def lower_deck(self) -> CrossSection:
        """Outline of the lower deck, with a round bay for each module; without slots."""
        m, deck = self.scale, self.outline
        bay = circle(_BAY * m) ^ rectangle((-99.0 * m, 99.0 * m), _scaled(_BAY_SIDES, m))
        bay = softened(bay, 4.0 * m)
        for azimuth in self.azimuths_deg:
            deck -= self.outline_in_base(bay, azimuth)
        return deck

    @cached_property
    def upper_deck(self) -> CrossSection:
        """Outline of the upper deck, without the sweep of moving parts; without slots."""
        m, deck = self.scale, self.outline
        far = 3.0 * (self.pivot + RIM * m)
        notch = rectangle(_scaled(_SWEEP, m), (_BAY_SIDES[0] * m, far), 16.0 * m)
        for azimuth in self.azimuths_deg:
            deck -= self.outline_in_base(notch, azimuth)
        # Drop the pieces that are not connected to the middle.
        pieces = softened(deck, 12.0 * m).decompose()
        return max(pieces, key=lambda piece: piece.area())

    @property
    def middle(self) -> float:
        """Minimum radius of the upper deck."""
        return self.pivot + _BAY_SIDES[0] * self.scale

    def reach(self, direction_deg: float, width: float) -> float:
        """Return the distance from the centre up to which a straight strip is on the upper deck."""
        return strip_reach(self.upper_deck, direction_deg, width)

    def carries(self, footprint: CrossSection) -> bool:
        """Return whether a footprint is completely on the upper deck."""
        return (footprint - self.upper_deck).area() < 1e-6


def half_gap_deg(azimuths_deg: Sequence[float]) -> float:
    """Return half of the smallest angle between neighbouring modules, at most 75 degrees."""
    return min(75.0, *(0.5 * gap for _, gap in gaps_deg(azimuths_deg)))


def _fit_between_modules(robot: SingularityDescription, size: Sequence[float]) -> float:
    """Return the scale at which servos of `size` fit next to each other in the middle."""
    drive = robot.drive
    wheel, plate = 1e3 * drive.wheel_radius_m, 1e3 * robot.body.plate_thickness_m
    rib = RIB_IN * (wheel / NOMINAL_WHEEL)
    room = 1e3 * drive.rms_radius_m - rib - plate
    if room < 0.2 * wheel:
        raise RobotFileError(
            robot.name,
            f"drive.pivot_radius_m is {drive.rms_radius_m:g}, too little for a body "
            f"with wheels of {drive.wheel_radius_m:g} m",
            f"at least {1e-3 * (rib + plate + 0.2 * wheel):.3f}",
        )
    # Neighbouring servos are boxes on the sides of a polygon whose far corners must not meet.
    slope = math.tan(math.radians(half_gap_deg(drive.directions_deg)))
    return room * slope / ((1.0 - HORN) * size[1] + slope * size[2])


def _clearance(robot: SingularityDescription, servo_width: float) -> float:
    """Return the height of the lower deck above the floor."""
    wheel, plate = 1e3 * robot.drive.wheel_radius_m, 1e3 * robot.body.plate_thickness_m
    clearance = min(1e3 * robot.body.ground_clearance_m, wheel - plate - 0.5 * servo_width - 0.5)
    if clearance < 0.05 * wheel:
        raise RobotFileError(
            robot.name,
            f"body.plate_thickness_m is {robot.body.plate_thickness_m:g}, too much for wheels of "
            f"{robot.drive.wheel_radius_m:g} m",
        )
    return clearance


def _scaled(span: tuple[float, float], by: float) -> tuple[float, float]:
    return span[0] * by, span[1] * by


def servo_case(size: Point) -> Manifold:
    """Draw the case, millimetres; its near end is at negative Y.

    Args:
        size: Width, length, and depth along the shaft.
    """
    width, length, depth = size
    x, y = _plan(size)
    corner = 0.05 * width
    body = slab(rectangle(x, y, corner), (-depth, 0.0))
    # Seams between front, middle and back of the case.
    waist = rectangle((x[0] + 0.6, x[1] - 0.6), (y[0] + 0.6, y[1] - 0.6), corner)
    seam = slab(rectangle((-width, width), (-length, length)) - waist, (-0.5, 0.5))
    seams = [seam.translate((0.0, 0.0, -share * depth)) for share in (0.22, 0.78)]
    socket = box(
        (-0.25 * width, 0.25 * width), (y[1] - 2.5, y[1] + 1.0), (-0.7 * depth, -0.42 * depth)
    )
    return body - union([*seams, socket])


def servo_fittings(size: Point) -> Manifold:
    """Draw the metal parts on the back of a case of `size`: screws, and the idler's bearing."""
    width, _, depth = size
    x, y = _plan(size)
    back = (-depth - 0.6, -depth + 1.0)
    screws = [
        rod(0.04 * width, back, at=(column, row, 0.0), corners=6)
        for column in (0.82 * x[0], 0.82 * x[1])
        for row in (y[0] + 0.09 * width, y[1] - 0.09 * width)
    ]
    return union([*screws, rod(0.2 * width, (-depth - 1.2, -depth + 1.0))])


def _plan(size: Point) -> tuple[Span, Span]:
    """Return the bounds of the case along X and Y."""
    width, length, _ = size
    return (-0.5 * width, 0.5 * width), (-HORN * length, (1.0 - HORN) * length)
