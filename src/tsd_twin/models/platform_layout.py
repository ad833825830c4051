"""Layout of a platform on omni wheels: dimensions that several drawings share."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from manifold3d import CrossSection, Manifold

from tsd_twin.models.omni_wheel import WheelPlan
from tsd_twin.models.solids import circle, rectangle, softened, strip_reach

NOMINAL_WHEEL = 76.2
"""Wheel radius that motors are drawn for: 6 inch wheels; other sizes are the same, scaled."""
MOTOR = 29.0
"""Radius of a 200 W motor; nominal."""
_TRAIN = 176.0
"""How far motor, gearbox and encoder reach inboard of the bracket; nominal."""
_BRACKET = 14.0
"""From the inboard face of a wheel to the far side of the bracket that the gearbox is bolted to;
nominal."""


@dataclass(frozen=True, slots=True)
class Mount:
    """Pose of a wheel in `base_link`, millimetres and degrees."""

    x: float
    y: float
    axle_deg: float
    """Direction of the axle, outward."""
    plan: WheelPlan

    def in_base(self, solid: Manifold) -> Manifold:
        """Return what is drawn in the frame of the wheel: Y outboard along the axle, Z up."""
        return solid.rotate((0.0, 0.0, self.axle_deg - 90.0)).translate((self.x, self.y, 0.0))

    def outline_in_base(self, outline: CrossSection) -> CrossSection:
        """Outline that is drawn in X and Y of the frame of the wheel."""
        return outline.rotate(self.axle_deg - 90.0).translate((self.x, self.y))


@dataclass(frozen=True, slots=True)
class PlatformLayout:
    """Millimetres in `base_link`, whose origin is as high as the axles."""

    mounts: tuple[Mount, ...]
    scale: float
    """Of motors and what is bolted to them."""
    train: float
    """Length of motor, gearbox and encoder: shorter than usual where they would meet."""
    plate: float
    """Thickness of the decks."""
    outline: CrossSection
    """Of both decks."""

    @classmethod
    def of(cls, mounts: Sequence[Mount], plate: float) -> PlatformLayout:
        """Lay out a platform."""
        scale = min(mount.plan.radius for mount in mounts) / NOMINAL_WHEEL
        train = next(
            (
                share * _TRAIN * scale
                for share in (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4)
                if _motors_fit(mounts, scale, share * _TRAIN * scale)
            ),
            0.3 * _TRAIN * scale,
        )
        return cls(tuple(mounts), scale, train, plate, _outline(mounts, scale))

    @property
    def floor(self) -> float:
        """How far below the origin the floor is."""
        return self.mounts[0].plan.radius

    @property
    def deck(self) -> float:
        """Height of the top of the lower deck: the motors lie on it."""
        return -(MOTOR + 3.0) * self.scale

    @property
    def roof(self) -> float:
        """Height of the underside of the upper deck."""
        return (MOTOR + 7.0) * self.scale

    @property
    def top(self) -> float:
        """Height of the top of the upper deck."""
        return self.roof + self.plate

    def face(self, mount: Mount) -> float:
        """Return where the bracket of a wheel ends inboard, along Y of the wheel."""
        return -mount.plan.half_width - _BRACKET * self.scale

    @property
    def middle(self) -> float:
        """The decks reach at least this far in every direction."""
        return min(self.reach(10.0 * i) for i in range(36))

    def reach(self, direction_deg: float, width: float = 8.0) -> float:
        """Return how far a straight strip from the middle stays on the decks."""
        return strip_reach(self.outline, direction_deg, width)


def _outline(mounts: Sequence[Mount], scale: float) -> CrossSection:
    """Polygon along the inboard faces of the wheels, which stand outside or in a notch."""
    corners: list[CrossSection] = []
    notches: list[CrossSection] = []
    corner = circle(9.0 * scale)
    for mount in mounts:
        half = 0.72 * mount.plan.radius
        near = -mount.plan.half_width - 15.0 * scale
        corners += [
            mount.outline_in_base(corner.translate((side * half, near))) for side in (-1.0, 1.0)
        ]
        wide = mount.plan.half_width + 6.0 * scale
        long = mount.plan.radius + 8.0 * scale
        notches.append(mount.outline_in_base(rectangle((-long, long), (-wide, 9.0 * wide))))
    outline = CrossSection.batch_hull(corners)
    for notch in notches:
        outline -= notch
    pieces: list[Any] = softened(outline, 5.0 * scale).decompose()
    return max(pieces, key=lambda piece: piece.area())


def _motors_fit(mounts: Sequence[Mount], scale: float, train: float) -> bool:
    """Return whether motors of a length do not overlap."""
    prints: list[CrossSection] = []
    half = (MOTOR + 2.0) * scale
    for mount in mounts:
        near = -mount.plan.half_width - _BRACKET * scale
        prints.append(mount.outline_in_base(rectangle((-half, half), (near - train, near))))
    return all((a ^ b).area() < 1e-6 for a, b in itertools.combinations(prints, 2))
