"""What a robot that should stand does instead, and which zeros of its gimbals explain that."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from tsd_twin.lie import SE2, Array
from tsd_twin.robots import RPM, SingularityRobot

LIMIT_M, LIMIT_S, LIMIT_RPM = 0.0254, 30.0, 2500.0
"""Gimbals count as zeroed when the robot creeps less than an inch in 30 s (thesis)."""
_CANDIDATES = 120_000
_SPARE = 0.8
"""Share of the limit that a change may leave: the smaller it is, the more it lets wheels push."""


@dataclass(frozen=True, slots=True, eq=False)
class Creep:
    """A constant twist (3,), in the body frame, at the speed the wheels had."""

    twist: Array
    spin_rpm: float
    sigma_mps: float = 0.0
    """Standard deviation of the velocity, in the direction in which it is known worst."""

    @property
    def way_m(self) -> float:
        """How far the centre goes in 30 s at 2,500 rpm: creep grows with that speed."""
        return float(np.hypot(*self.twist[:2])) * LIMIT_S * self._to_limit

    @property
    def way_sigma_m(self) -> float:
        """How well that is known: one standard deviation."""
        return self.sigma_mps * LIMIT_S * self._to_limit

    @property
    def turn_rad(self) -> float:
        """How far it turns in that time."""
        return float(self.twist[2]) * LIMIT_S * self._to_limit

    @property
    def passes(self) -> bool:
        """Whether the gimbals count as zeroed."""
        return self.way_m < LIMIT_M

    @property
    def _to_limit(self) -> float:
        return LIMIT_RPM / self.spin_rpm

    def sentence(self) -> str:
        """Return it in words, for 30 s at 2,500 rpm."""
        vx, vy, _ = self.twist
        toward = np.degrees(np.arctan2(vy, vx))
        return (
            f"{1000 * self.way_m:.1f} mm in {LIMIT_S:.0f} s, towards {toward:.0f} deg, "
            f"and turns {np.degrees(self.turn_rad):.1f} deg"
        )


def creep_of(t_s: Array, poses: Array, spin_rpm: float) -> Creep:
    """Return the constant twist that fits poses (n, 3) best; times (n,) rise.

    The heading gives the turn rate, and with it the way is linear in the velocity.
    """
    after_s = t_s - t_s[0]
    seen = poses.copy()
    seen[:, 2] = np.unwrap(seen[:, 2])
    by_line = np.column_stack([after_s, np.ones_like(after_s)])
    turning, start = np.linalg.lstsq(by_line, seen[:, 2], rcond=None)[0].tolist()
    # Where the noise of the first pose turns all others, the line through all headings does not.
    local = SE2(np.array([0.0, 0.0, -start])).rotate(seen[:, :2])
    rows = np.zeros((len(t_s), 2, 4))
    for i in (0, 1):
        twists = np.zeros((len(t_s), 3))
        twists[:, i], twists[:, 2] = 1.0, turning
        rows[:, :, i] = SE2.exp(twists * after_s[:, None]).xy_heading[:, :2]
        rows[:, i, 2 + i] = 1.0
    flat = rows.reshape(-1, 4)
    found = np.linalg.lstsq(flat, local.ravel(), rcond=None)[0]
    squares = np.square(local.ravel() - flat @ found).sum() / max(1, len(flat) - 4)
    spread = squares * np.linalg.pinv(flat.T @ flat)[:2, :2]
    sigma_mps = float(np.sqrt(max(0.0, np.linalg.eigvalsh(spread)[-1])))
    return Creep(np.array([found[0], found[1], turning]), spin_rpm, sigma_mps)


def creep_by_hand(moved_m: Array, turned_rad: float, seconds: float, spin_rpm: float) -> Creep:
    """Return the twist that ended `moved_m` (2,) away, axes as at the start, turned in all."""
    return Creep(SE2(np.append(moved_m, turned_rad)).log() / seconds, spin_rpm)


def by_zeros(robot: SingularityRobot) -> Array:
    """Return (3, 2k): the twist of a robot told to stand, by the angles its gimbals stand at.

    Contact velocities of upright wheels are r_w spin (alpha, -beta).
    """
    drive = robot.kinematics()
    rims_mps = drive.wheel_radius_m * drive.spin_rad_per_s * drive.spin_ratio
    return drive.twist_from_contacts * np.outer(rims_mps, [1.0, -1.0]).ravel()


def spin_rpm(robot: SingularityRobot) -> float:
    """Return the mean speed of the wheels when the robot is ready."""
    drive = robot.kinematics()
    return float(np.mean(drive.spin_rad_per_s * drive.spin_ratio)) / RPM


def steps_that_end(robot: SingularityRobot, creep: Creep) -> tuple[Array, Creep]:
    """Return by how many servo steps (2k,) zeros are off, and the creep with that put right.

    Three things are seen of six zeros and more, so many changes explain them. Of those, and of the
    whole steps that servos go in, this is the smallest that stays within the limit;
    where there is none, the one that leaves least.
    """
    matrix, step_rad = by_zeros(robot), 2.0 * np.pi / robot.servo.steps_per_turn
    exact = np.linalg.pinv(matrix) @ creep.twist / step_rad
    wide = max(1, int(_CANDIDATES ** (1.0 / len(exact))))
    around = np.arange(wide) - (wide - 1) // 2
    near = np.array(list(itertools.product(around, repeat=len(exact))), dtype=float)
    steps = np.rint(exact) + near
    left = creep.twist - steps @ (step_rad * matrix).T
    least_turn = np.abs(left[:, 2]).min()
    turns_least = np.abs(left[:, 2]) <= 1.01 * least_turn + 1e-9
    way_m = np.hypot(left[:, 0], left[:, 1]) * LIMIT_S * LIMIT_RPM / creep.spin_rpm
    size = np.square(steps - exact).sum(axis=1)
    good = turns_least & (way_m < _SPARE * LIMIT_M)
    cost = np.where(good, size, np.inf) if good.any() else np.where(turns_least, way_m, np.inf)
    best = int(np.argmin(cost))
    return steps[best], Creep(left[best], creep.spin_rpm)
