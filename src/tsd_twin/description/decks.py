"""Outlines of the two decks, which everything else of the chassis is fitted to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from manifold3d import CrossSection

from tsd_twin.description.layout import Layout
from tsd_twin.description.solids import circle, rectangle, softened

RIM = 84.0
"""Radius of the corners of the decks about the pivots; nominal."""
_BAY = 63.0
"""Radius of the round bays, which the frames dip into at full tilt; nominal."""
_BAY_SIDES = (-57.0, 55.5)
"""Flat sides of the bays, where the ribs stand; nominal, along Y of the module."""
_SWEEP = (-64.0, 88.0)
"""How far the outer frame with its servo reaches at full tilt; nominal, along X of the module."""


@dataclass(frozen=True, slots=True)
class Decks:
    """Outlines in `base_link`, millimetres, before slots are cut."""

    lower: CrossSection
    """A polygon with round corners and one round bay for each module."""
    upper: CrossSection
    """What moving parts leave free of the same polygon."""
    middle: float
    """The upper deck reaches this far in every direction."""

    @classmethod
    def of(cls, layout: Layout) -> Decks:
        """Return the outlines of the decks of a robot."""
        m = layout.scale
        corners = [layout.outline_in_base(circle(RIM * m), a) for a in layout.azimuths_deg]
        # Three modules need no more than a triangle; two, or uneven ones, also need a middle.
        outline = CrossSection.batch_hull([*corners, circle(layout.pivot - 20.0 * m)])
        bay = circle(_BAY * m) ^ rectangle((-99.0 * m, 99.0 * m), _scaled(_BAY_SIDES, m))
        bay = softened(bay, 4.0 * m)
        far = 3.0 * (layout.pivot + RIM * m)
        notch = rectangle(_scaled(_SWEEP, m), (_BAY_SIDES[0] * m, far), 16.0 * m)
        lower, upper = outline, outline
        for azimuth in layout.azimuths_deg:
            lower -= layout.outline_in_base(bay, azimuth)
            upper -= layout.outline_in_base(notch, azimuth)
        # Pieces that no longer hang together with the middle would float in the air.
        pieces = softened(upper, 12.0 * m).decompose()
        largest = max(pieces, key=lambda piece: piece.area())
        return cls(lower, largest, layout.pivot + _BAY_SIDES[0] * m)

    def reach(self, direction_deg: float, width: float) -> float:
        """Return how far a straight strip from the middle stays on the upper deck."""
        strip = rectangle((0.0, 1e4), (-0.5 * width, 0.5 * width))
        pieces: list[Any] = (self.upper.rotate(-direction_deg) ^ strip).decompose()
        near_far = [(bounds[0], bounds[2]) for bounds in (piece.bounds() for piece in pieces)]
        return min(near_far)[1]

    def carries(self, footprint: CrossSection) -> bool:
        """Tell whether a footprint lies wholly on the upper deck."""
        return (footprint - self.upper).area() < 1e-6


def _scaled(span: tuple[float, float], by: float) -> tuple[float, float]:
    return span[0] * by, span[1] * by
