"""Between joints and their actuators: what a calibration has found out about one machine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsd_twin.lie import Array


@dataclass(frozen=True, slots=True, eq=False)
class Trim:
    """A gimbal stands `offset` beside where its servo says; a wheel turns `scale` times as fast.

    Joints are what the drive reckons with. Servos and motor tables are told, and tell, something
    else, and this is the only place where one becomes the other.
    """

    offset: Array
    """(n,): radians, 0 for wheels."""
    scale: Array
    """(n,): 1 for gimbals."""

    def __post_init__(self) -> None:
        for name in ("offset", "scale"):
            value = np.array(getattr(self, name), dtype=float)
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    def told(self, joints: Array) -> Array:
        """Return what actuators are told (..., n) so that the joints do `joints` (..., n)."""
        return (joints - self.offset) / self.scale

    def done(self, told: Array) -> Array:
        """Return what joints do (..., n) when their actuators are told `told` (..., n)."""
        return told * self.scale + self.offset

    def measured(self, said: Array) -> Array:
        """Return joints (..., n) from what servos say; the speed of a wheel is measured itself."""
        return said + self.offset

    def said(self, joints: Array) -> Array:
        """Return what servos say (..., n) of `joints` (..., n): `measured` undone."""
        return joints - self.offset
