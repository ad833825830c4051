"""Joint rounding of the goals of all gimbal servos to whole encoder steps.

Rounded one by one, the goals of a robot that drives straight ahead add up to a turn. Each goal may
be rounded down or up; of these combinations, the one nearest to the twist is chosen.
"""

from __future__ import annotations

import math

import numpy as np

from tsd_twin.kinematics.singularity import SingularityKinematics
from tsd_twin.lie import Array
from tsd_twin.robots import RobotDescription, SingularityDescription

HELD_S = 0.1
"""Time after which unchanged gimbal setpoints are rounded together. Before, each servo rounds its
own goal: in a ramp, joint rounding would reverse the goals from period to period."""
_TOGETHER = 4
"""Number of modules whose 4^4 combinations are compared in one operation."""
_MOST_ROUNDS = 8
"""Maximum number of passes over the modules of robots with more than `_TOGETHER`."""
_GAIN = 1e-12
"""(m/s)^2: smaller improvements are numerical; servo steps cause about 1e-5."""
_ON_STEP = 1e-6
"""Angles this close to a step, in steps, are on it and are not rounded to another."""
_OPTIONS = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]])
"""Options of a module: for alpha and beta, the nearest step (first) or that on the other side."""


class GoalRounding:
    """Rounds gimbal angles to servo steps so that the body twist changes as little as possible.

    The distance between twists is the root of vx^2 + vy^2 + (R omega)^2, where R is the root mean
    square distance of the pivots. By forward kinematics it is never larger than with goals rounded
    one by one, and each goal differs from those by at most one step. Among these combinations, the
    sum of the squared distances by forward kinematics and with leaning gimbals is smallest, because
    modules that disagree push one another aside (`SingularityDescription.lean_by_slip`).
    """

    def __init__(self, robot: SingularityDescription) -> None:
        k, kinematics = robot.drive.modules, robot.kinematics()
        self._step_rad = 2.0 * math.pi / robot.servo.steps_per_turn
        self._offset_rad = robot.actuator_offsets().offset.reshape(k, 3)[:, :2]
        most_rad = math.radians(robot.drive.max_tilt_deg)
        # The limit applies to the gimbal, which may be offset from its servo.
        self._least = np.ceil((-most_rad - self._offset_rad) / self._step_rad)
        self._most = np.floor((most_rad - self._offset_rad) / self._step_rad)
        self._most_sine = math.sin(most_rad)
        weights = np.array([1.0, 1.0, robot.drive.rms_radius_m])
        self._maps: Array = weights[:, None] * np.stack(
            [_sliding(kinematics, 0.0), _sliding(kinematics, robot.lean_by_slip)], axis=1
        )
        self._since: tuple[bytes, float] = (b"", math.inf)
        self._rounded: Array | None = None

    @staticmethod
    def of(robot: RobotDescription) -> GoalRounding | None:
        """Return the rounding for `robot`, or None if it has no gimbals."""
        return GoalRounding(robot) if isinstance(robot, SingularityDescription) else None

    def step(self, now_s: float, kinematics: SingularityKinematics, joints: Array) -> Array:
        """Return `joints` (3k,), with gimbals at whole steps if unchanged for `HELD_S`.

        `kinematics` are those that computed the gimbals.
        """
        gimbals = joints.reshape(-1, 3)[:, :2]
        asked = gimbals.tobytes()
        if self._since[0] != asked:
            self._since, self._rounded = (asked, now_s), None
        if now_s - self._since[1] < HELD_S:
            return joints
        if self._rounded is None:
            self._rounded = self.together(kinematics, gimbals)
        held = joints.reshape(-1, 3).copy()
        held[:, :2] = self._rounded
        return held.ravel()

    def together(self, kinematics: SingularityKinematics, gimbals: Array) -> Array:
        """Return `gimbals` (k, 2), rounded so that the resulting twist is nearest.

        Modules that would exceed the tilt limit are excluded, unless the nearest steps exceed it.
        """
        k = len(gimbals)
        exact = (gimbals - self._offset_rad) / self._step_rad
        nearest = np.minimum(np.maximum(np.rint(exact), self._least), self._most)
        beyond = exact - nearest
        other_side = np.sign(beyond) * (np.abs(beyond) > _ON_STEP)
        steps = nearest + _OPTIONS[:, None] * other_side
        options = np.empty((len(_OPTIONS) + 1, k, 3))
        options[:-1, :, :2] = steps * self._step_rad + self._offset_rad
        options[-1, :, :2] = gimbals
        options[..., 2] = kinematics.spin_rad_per_s * kinematics.spin_ratio
        tilts = kinematics.tilt(options.reshape(len(options), -1))[:-1]
        allowed = np.sin(tilts) <= np.maximum(self._most_sine, np.sin(tilts[0]))
        allowed &= ((steps >= self._least) & (steps <= self._most)).all(axis=-1)
        allowed[0] = True
        contacts = kinematics.contacts(options.reshape(len(options), -1))
        changes = (contacts[:-1] - contacts[-1]).swapaxes(0, 1)  # (k, options, 2)
        errors = changes @ self._maps.reshape(k, 6, 2).swapaxes(-1, -2)
        chosen = _least_sum(errors, allowed.T)
        return np.asarray(options[chosen, np.arange(k), :2], dtype=float)


def _sliding(kinematics: SingularityKinematics, lean: float) -> Array:
    """Return the twist (k, 3, 2) per rolling velocity of each wheel; `lean` is 0 for stiff gimbals.

    Wheels that disagree slide. The force of the floor, proportional to the slip s, tilts the
    gimbals and so adds `lean` times s, turned by a quarter turn, to the rolling velocity v. Hence
    s = M (v - H twist), and the forces are balanced: H' s = 0.
    """
    slip = np.linalg.inv(np.array([[1.0, lean], [-lean, 1.0]]))
    h = kinematics.contact_from_twist
    by_wheel = h.swapaxes(-1, -2) @ slip
    return np.asarray(np.linalg.solve((by_wheel @ h).sum(axis=0), by_wheel), dtype=float)


def _least_sum(errors: Array, allowed: Array) -> Array:
    """Choose an option for each module so that the sum of their errors is shortest.

    Only choices whose first three components are no longer than with all first options. Exact for
    up to `_TOGETHER` modules. For more, groups of neighbours are optimized in turn, beginning with
    the first options, until no group improves.

    Args:
        errors: (k, options, 6): twist error of stiff gimbals, and of gimbals that lean.
        allowed: (k, options).

    Returns:
        (k,): index of the option of each module.
    """
    k = len(errors)
    every, chosen = np.arange(k), np.zeros(k, dtype=int)
    first = errors[:, 0].sum(axis=0) ** 2
    bound, best = float(first[:3].sum()), float(first.sum())
    groups = [every]
    if k > _TOGETHER:
        groups = [(start + np.arange(_TOGETHER)) % k for start in range(k)]
    for _ in range(_MOST_ROUNDS):
        before = best
        for group in groups:
            others = np.setdiff1d(every, group)
            sums = errors[others, chosen[others]].sum(axis=0)
            places = [np.flatnonzero(allowed[module]) for module in group]
            for module, own in zip(group, places, strict=True):
                sums = sums[..., None, :] + errors[module, own]
            squares = sums * sums
            lengths = np.where(
                squares[..., :3].sum(axis=-1) <= bound, squares.sum(axis=-1), np.inf
            )
            at = int(lengths.argmin())
            if lengths.flat[at] < best - _GAIN:
                best = float(lengths.flat[at])
                indices = np.unravel_index(at, lengths.shape)
                chosen[group] = [own[i] for own, i in zip(places, indices, strict=True)]
        if best == before or len(groups) == 1:
            break
    return chosen
