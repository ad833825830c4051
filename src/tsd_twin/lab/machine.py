"""A simulated machine that is not what its description says."""

from __future__ import annotations

import msgspec
import numpy as np

from tsd_twin.lie import Array
from tsd_twin.robots import SingularityRobot
from tsd_twin.sim import SimRobot

OFFSET_DEG = 0.3
"""Standard deviation of what is drawn: of a gimbal's zero, put upright with a level (assumed)."""
RADIUS_SHARE, SPIN_SHARE = 0.01, 0.01
"""The same of both radii, measured with a ruler, and of a motor's curve (assumed)."""


class Machine(SimRobot):
    """Simulates `true`, for a core that takes it for `believed`.

    What crosses over are servo angles and throttles, which both understand; each has a calibration
    of its own to make joints of them.
    """

    def __init__(
        self,
        believed: SingularityRobot,
        true: SingularityRobot,
        seed: int,
        noise: float,
        errors: float = 0.0,
    ) -> None:
        super().__init__(true, seed=seed, noise=noise, errors=errors)
        self._believed, self._true = believed.trim(), true.trim()

    def read(self, now_s: float) -> Array:
        """Return what is measured (n,), in joints as they are believed to be."""
        return self._believed.measured(self._true.said(super().read(now_s)))

    def write(self, setpoint: Array, now_s: float) -> None:
        """Take set-points (n,) for joints as they are believed to be."""
        super().write(self._true.done(self._believed.told(setpoint)), now_s)


def built(believed: SingularityRobot, random: np.random.Generator) -> SingularityRobot:
    """Return a machine as it may have been built from a description, with errors of its own.

    Zeros and spins that a description has among its errors or its noise are left out: what is off
    about these is in `[calibration]`, where it can be compared with what is found.
    """
    modules = believed.drive.modules
    trim = believed.trim()
    offset = np.degrees(trim.offset).reshape(modules, 3)[:, :2]
    offset = offset + OFFSET_DEG * random.standard_normal((modules, 2))
    scale = trim.scale.reshape(modules, 3)[:, 2] * (
        1.0 + SPIN_SHARE * random.standard_normal(modules)
    )
    radii = 1.0 + RADIUS_SHARE * random.standard_normal(2)
    return corrected(
        msgspec.structs.replace(
            believed,
            noise=msgspec.structs.replace(believed.noise, spin_share=0.0),
            errors=msgspec.structs.replace(believed.errors, zero_deg=0.0),
        ),
        offset,
        scale,
        believed.drive.wheel_radius_m * radii[0],
        believed.drive.pivot_radius_m * radii[1],
    )


def corrected(
    robot: SingularityRobot,
    offset_deg: Array,
    scale: Array,
    wheel_radius_m: float,
    pivot_radius_m: float,
) -> SingularityRobot:
    """Return the robot with other radii, zeros `offset_deg` (k, 2) and spins `scale` (k,)."""
    pairs = [(float(alpha), float(beta)) for alpha, beta in offset_deg]
    return msgspec.structs.replace(
        robot,
        drive=msgspec.structs.replace(
            robot.drive, wheel_radius_m=float(wheel_radius_m), pivot_radius_m=float(pivot_radius_m)
        ),
        calibration=msgspec.structs.replace(
            robot.calibration, tilt_offset_deg=pairs, spin_scale=[float(each) for each in scale]
        ),
    )
