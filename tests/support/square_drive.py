"""Square by odometry, as in a user's program, without imports of the package."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

NEAR_M = 0.004
_GAIN_PER_S = 1.5
_SLOWEST_MPS = 0.01


@dataclass
class SquareDrive:
    """Twists to the four corners in turn, at the initial heading."""

    side_m: float
    speed_mps: float
    _corners: list[tuple[float, float]] = field(default_factory=list)
    _heading: float = 0.0
    _begun: bool = False

    @property
    def path_m(self) -> float:
        return 4.0 * self.side_m

    def twist(self, x_m: float, y_m: float, heading: float) -> tuple[float, float, float] | None:
        """Return vx, vy and turn rate at a pose, or None after the last corner."""
        if not self._begun:
            self._begun, self._heading = True, heading
            for along, left in ((1, 0), (1, 1), (0, 1), (0, 0)):
                dx, dy = along * self.side_m, left * self.side_m
                self._corners.append((x_m + dx, y_m + dy))
        while self._corners:
            dx, dy = self._corners[0][0] - x_m, self._corners[0][1] - y_m
            away_m = math.hypot(dx, dy)
            if away_m >= NEAR_M:
                speed = min(self.speed_mps, _GAIN_PER_S * away_m + _SLOWEST_MPS) / away_m
                c, s = math.cos(heading), math.sin(heading)
                turned = math.remainder(self._heading - heading, math.tau)
                return speed * (c * dx + s * dy), speed * (c * dy - s * dx), turned
            del self._corners[0]
        return None
