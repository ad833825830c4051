"""What is wrong with a real machine, and that nobody told it: for the simulator alone."""

from __future__ import annotations

import math

import msgspec

from tsd_twin.errors import TwinError
from tsd_twin.robots.robot import NotNegative, Positive, Table


class Floor(Table, frozen=True):
    """`[floor]`: what a wheel that spins on the spot rubs on, for plants with friction."""

    friction: NotNegative = 0.8
    """Coefficient: rubber, or a printed wheel, on a dry hard floor."""
    patch_radius_m: Positive = 0.0005
    """Of the spot that touches. By Hertz: 10 N on a sphere of 40 mm of hard plastic (2 GPa)."""


class Imperfections(Table, frozen=True):
    """`[errors]`: how a built robot differs from its description. 0 is none, of each."""

    zero_deg: NotNegative = 0.0
    """Standard deviation of where each gimbal has its zero: it stands there when told 0."""
    dead_band_deg: NotNegative = 0.0
    """A gimbal servo that is this close to its goal does not move any more."""
    backlash_deg: NotNegative = 0.0
    """Play of its gears, in all: after a reversal the motor turns so far alone."""
    delay_s: NotNegative = 0.0
    """Set-points reach the actuators so much later, and measurements are so old."""
    battery_share: NotNegative = 0.0
    """Standard deviation of the battery's voltage, as a share of the nominal one."""
    layer_m: NotNegative = 0.0
    """Height of a printed layer: the radius of a wheel is wrong by up to half of it."""

    def scaled(self, scale: float) -> Imperfections:
        """Return all of them `scale` times as large; 0 is a machine without any.

        Raises:
            TwinError: the scale is negative, or not a number.
        """
        if not 0.0 <= scale < math.inf:
            raise TwinError(f"errors are scaled by 0, which is none, or more, not by {scale:g}")
        return msgspec.structs.replace(
            self, **{name: scale * getattr(self, name) for name in self.__struct_fields__}
        )
