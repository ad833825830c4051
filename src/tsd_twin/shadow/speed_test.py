"""Fault test of measured wheel speeds against their set-points."""

from __future__ import annotations

import numpy as np

from tsd_twin.estimation.joint_errors import acceleration
from tsd_twin.lie import Array
from tsd_twin.robots import RobotDescription
from tsd_twin.shadow.fault_filter import FaultFilter, Hypothesis, with_pairs

_BLOCK_S = 0.25
_LOSS, _LEAST_LOSS = 0.1, 0.025
"""Typical and least relative loss of speed."""
_LAG_S, _OWN_LAG_S, _DROOP_S, _DRAG = 0.1, 0.03, 0.1, 0.003
"""Standard deviations: common lag, individual lag, droop under load (speed lost per acceleration of
the robot), and droop by friction, relative to the highest speed.
Wheel loops with an integral part have no droop."""
_LAG_NOISE, _SETTLES = 0.3, 0.35
"""Error of lag and droop that is independent in each block, and the part of it in the next block:
an integral part settles slowly."""
_SPEED_SHARE, _TOP_SHARE = 0.005, 0.004
"""Noise of a mean speed, relative to it and to the highest speed."""


class SpeedTest:
    """Tests for wheels that turn slower than their set-points, in blocks of 0.25 s."""

    def __init__(self, robot: RobotDescription) -> None:
        self._kinematics = kinematics = robot.kinematics()
        self._inverse = kinematics.inverse(np.eye(3))
        """(3, k): wheel speeds per twist."""
        limit = np.array([robot.limits.speed_mps / kinematics.twist_scale_m, 0.0, 0.0])
        self._top = float(np.abs(kinematics.inverse(limit)).max())
        count = self._count = len(kinematics.joints)
        own = max(robot.joint_errors().speed_scale_sigma, 0.002)
        sigma = np.concatenate(
            [
                np.full(count, own),
                [_LAG_S, _DROOP_S],
                np.full(count, _OWN_LAG_S),
                np.full(count, _DRAG * self._top),
            ]
        )
        parts = with_pairs([Hypothesis((i,), positive=True) for i in range(count)])
        parts.append(Hypothesis(tuple(range(count)), together=True, positive=True))
        sizes = np.full(count, _LOSS), np.full(count, _LEAST_LOSS)
        self.filter = FaultFilter(sigma, *sizes, parts)
        self._unsettled = np.zeros(count)
        self.restart()

    def restart(self) -> None:
        """Begin again after a gap."""
        self._took_s = 0.0
        self._error, self._speed = np.zeros((2, self._count))
        self._load, self._varied = np.zeros((2, self._count))
        self._first: Array | None = None
        self._twist = np.zeros(3)

    def add(self, measured: Array, wanted: Array, dt_s: float, *, warm: bool) -> None:
        """Add measured speeds (k,) and the set-points (k,) of the last `dt_s`."""
        twist = self._kinematics.forward(wanted).twist
        if not warm or not np.isfinite(measured).all():
            self.restart()
            self._twist = twist
            return
        if self._first is None:
            self._first = wanted
            self._last, self._twist = wanted, twist
        push = acceleration(self._twist, twist, dt_s) @ self._inverse
        self._error += dt_s * (measured - wanted)
        self._speed += dt_s * wanted
        self._load += dt_s * push
        self._varied += np.maximum(np.abs(wanted - self._last), dt_s * np.abs(push))
        self._last, self._twist = wanted, twist
        self._took_s += dt_s
        if self._took_s >= _BLOCK_S - 1e-6:
            self._judge(wanted - self._first)
            self.restart()
            self._first = self._last = wanted
            self._twist = twist

    def _judge(self, changed: Array) -> None:
        took_s = self._took_s
        error, speed = self._error / took_s, self._speed / took_s
        lag, load = -changed / took_s, -self._load / took_s
        if np.abs(speed).max() < 0.02 * self._top:
            return
        loss = -np.diag(speed)
        drag = -np.diag(np.tanh(speed / (0.05 * self._top)))
        rows = np.hstack([loss, lag[:, None], load[:, None], np.diag(lag), drag])
        self._unsettled = np.maximum(self._varied / took_s, _SETTLES * self._unsettled)
        noise = _LAG_NOISE * (_LAG_S + _DROOP_S) * self._unsettled
        noise = (_SPEED_SHARE * speed) ** 2 + (_TOP_SHARE * self._top) ** 2 + noise**2
        self.filter.predict(np.ones(len(self.filter.sigma)), np.zeros(len(self.filter.sigma)))
        self.filter.add(error, rows, loss, np.diag(noise))
