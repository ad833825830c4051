"""Effect of the two rows of rollers on a sphere's motion: Fig. 7 of Weiss et al. 2008."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsd_twin.kinematics.omni import SphereKinematics
from tsd_twin.lie import Array

TABLE_1 = np.array(
    [
        [0.0, 1.0, 0.0, 0.0],
        [0.1, 1.0, 1.0, 1.0],
        [1.0, 1.0, 2.0, 2.0],
        [2.0, 2.0, 1.0, 1.0],
        [3.0, 2.0, 1.0, 2.0],
        [4.0, 0.0, 0.0, 1.0],
        [5.0, 1.0, 0.0, 0.0],
        [6.0, 0.0, 1.0, 0.0],
        [7.0, 1.0, 2.0, 3.0],
        [8.0, 2.0, 1.0, 3.0],
        [9.0, 1.0, 3.0, 2.0],
        [10.0, 2.0, 3.0, 1.0],
        [11.0, 3.0, 1.0, 2.0],
        [12.0, 3.0, 2.0, 1.0],
        [13.0, 0.0, 0.0, 0.0],
    ]
)
"""Time, s, and speeds of the three wheels, rad/s, interpolated linearly between the rows."""
STEP_S = 0.001


@dataclass(frozen=True, slots=True, eq=False)
class RowEffect:
    """Ideal and dual-row motion of a sphere at the same wheel speeds, with a row per time."""

    t_s: Array
    speeds: Array
    """(n, 3): wheel speeds, rad/s."""
    ideal: Array
    """(n, 3): angular velocity with contacts midway between the rows, rad/s."""
    true: Array
    """(n, 3): angular velocity by the dual-row model, rad/s."""

    @property
    def angle_rad(self) -> Array:
        """(n,): angle between the two angular velocities; 0 at standstill."""
        across = np.linalg.norm(np.cross(self.ideal, self.true), axis=-1)
        return np.arctan2(across, np.sum(self.ideal * self.true, axis=-1))

    @property
    def share(self) -> Array:
        """(n,): relative magnitude error 1 - |ideal| / |true|; 0 at standstill."""
        ideal, true = (np.linalg.norm(each, axis=-1) for each in (self.ideal, self.true))
        return np.where(true > 0.0, 1.0 - ideal / np.where(true > 0.0, true, 1.0), 0.0)

    def columns(self) -> dict[str, Array]:
        """Return the columns of a table."""
        table = {"t_s": self.t_s}
        for i in range(self.speeds.shape[1]):
            table[f"wheel{i + 1}_rad_per_s"] = self.speeds[:, i]
        for name, twist in (("ideal", self.ideal), ("true", self.true)):
            for i, axis in enumerate("xyz"):
                table[f"{name}_w{axis}_rad_per_s"] = twist[:, i]
        return table | {"angle_deg": np.degrees(self.angle_rad), "share_percent": 100 * self.share}


def row_effect(drive: SphereKinematics) -> RowEffect:
    """Return the dual-row effect for the wheel speeds of Table 1, linear between times."""
    table_s, *table = TABLE_1.T
    start, end = float(table_s[0]), float(table_s[-1])
    t: Array = np.linspace(start, end, round((end - start) / STEP_S) + 1)
    columns: list[Array] = [np.interp(t, table_s, column) for column in table]
    speeds: Array = np.stack(columns, axis=-1)
    # The trapezoidal rule is exact for a speed that is linear in time.
    steps: Array = 0.5 * (speeds[1:] + speeds[:-1]) * np.diff(t)[:, None]
    angles: Array = np.concatenate([np.zeros((1, speeds.shape[1])), np.cumsum(steps, axis=0)])
    ideal = drive.forward(speeds).twist
    return RowEffect(t, speeds, ideal, drive.true_twist(speeds, drive.side(angles)))
