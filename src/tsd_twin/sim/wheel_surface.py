"""Wheels that are printed in layers: their radius is not the same all over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsd_twin.drives import SingularityDrive
from tsd_twin.lie import Array


@dataclass(frozen=True, slots=True, eq=False)
class WheelSurface:
    """The radius at which wheels of a drive roll, by the tilt of their axles.

    Layers lie across the axle. A surface of them is up to half a layer outside or inside of the
    sphere, and passes from one to the other once in a layer; what rolls on its edges rounds them.
    Where the first layer begins differs from wheel to wheel. That a hard wheel on a hard floor
    would stand on an edge, and be driven by it whatever its tilt, is not in here.
    """

    drive: SingularityDrive
    layer_m: float
    phase_rad: Array
    """(..., k)."""

    @staticmethod
    def of(
        drive: SingularityDrive, layer_m: float, random: np.random.Generator, shape: tuple[int, ...]
    ) -> WheelSurface:
        """Return wheels with layers of `layer_m` that begin anywhere; `shape` is (..., k)."""
        return WheelSurface(drive, layer_m, random.uniform(0.0, 2.0 * np.pi, shape))

    def outside_m(self, joints: Array) -> Array:
        """Return by how much the radius (..., k) at the floor is larger than described."""
        if self.layer_m == 0.0:
            return np.zeros(self.phase_rad.shape)
        modules = joints.reshape(*joints.shape[:-1], self.drive.modules, 3)
        upright = np.cos(modules[..., 0]) * np.cos(modules[..., 1])
        layers = self.drive.wheel_radius_m * (1.0 - upright) / self.layer_m
        return 0.5 * self.layer_m * np.sin(2.0 * np.pi * layers + self.phase_rad)

    def roll(self, joints: Array) -> Array:
        """Return joints (..., n) that roll on spheres as `joints` do on these wheels."""
        if self.layer_m == 0.0:
            return joints
        rolling = joints.copy()
        rolling[..., 2::3] *= 1.0 + self.outside_m(joints) / self.drive.wheel_radius_m
        return rolling
