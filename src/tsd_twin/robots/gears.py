"""The speeds that the wheels of a singularity drive may spin at, and what each costs."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tsd_twin.drives import SingularityDrive
from tsd_twin.robots.units import RPM

_LAG_SHARE = 0.1
"""Share of its speed that a motor may be behind while the speed is changed: what the model has
wrong of a time constant shows in the motion by this share of it."""


@dataclass(frozen=True, slots=True, eq=False)
class Gears:
    """A gear without steps: any spin between two, chosen by the speed range that is wanted.

    All follows from rolling, v = r_w spin sin(tilt): a faster wheel drives faster at the same tilt,
    and by as much more with each step of a servo. The page shows both (`static/gear.js`).
    """

    drive: SingularityDrive
    """In the gear of the description."""
    least_rad_per_s: float
    """The slowest spin at which all motors turn."""
    most_rad_per_s: float
    """The fastest spin that all motors reach."""
    servo_step_rad: float

    def top_speed_mps(self, spin_rad_per_s: float) -> float:
        """Return the speed of a wheel over the ground at the tilt limit."""
        rim_mps = self.drive.wheel_radius_m * spin_rad_per_s
        return rim_mps * math.sin(self.drive.max_tilt_rad)

    def refusal(self, spin_rad_per_s: float) -> str:
        """Return why a spin cannot be chosen, as part of a sentence; "" when it can."""
        # What is not a number is not between them.
        if self.least_rad_per_s <= spin_rad_per_s <= self.most_rad_per_s:
            return ""
        least, most = self.least_rad_per_s / RPM, self.most_rad_per_s / RPM
        return f"the wheels turn at {least:,.0f} to {most:,.0f} rpm"

    def rate_rad_per_s2(
        self, spin_rad_per_s: float, time_constant_s: float, deceleration_mps2: float
    ) -> float:
        """Return how fast the spin may be changed while the robot drives.

        Its motors follow to within a tenth, and the top speed falls no faster than the robot brakes
        within its limits.
        """
        fall = deceleration_mps2 / self.top_speed_mps(1.0)
        return min(_LAG_SHARE * spin_rad_per_s / time_constant_s, fall)
