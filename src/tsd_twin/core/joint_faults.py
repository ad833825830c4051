"""What is wrong with the joints: nobody measures them, or one does not go where it is told."""

from __future__ import annotations

import numpy as np

from tsd_twin.authority import ARMED, Authority, Mode
from tsd_twin.core.estimator import Estimator
from tsd_twin.core.following import Following
from tsd_twin.lie import Array
from tsd_twin.messages.status import ConflictStatus

SILENT_S = 0.1
"""Joints that are not measured for this long are a fault while armed."""


class JointFaults:
    """Looks at what is measured of the joints, and keeps what a fault was told by."""

    def __init__(self, estimator: Estimator) -> None:
        self._estimator = estimator
        self._angles = np.flatnonzero(estimator.is_angle)
        self._following = Following([estimator.drive.joints[i].name for i in self._angles])
        self.evidence: ConflictStatus | None = None
        """What the others said of a gimbal that stuck; it stays to be seen until the reset."""

    def silent(self, now_s: float) -> bool:
        """Return whether the joints have not been measured for too long."""
        return now_s - self._estimator.measured_s > SILENT_S

    def step(self, now_s: float, setpoint: Array, authority: Authority, fault: str) -> str:
        """Return what is wrong, in words, "" if nothing is; `fault` is what the board objects to.

        `setpoint` (n,) is what the joints were told last.
        """
        if self.silent(now_s) and not fault:
            fault = f"the joints have not been measured for {SILENT_S * 1000:.0f} ms"
        return fault or self._stuck(now_s, setpoint, authority)

    def _stuck(self, now_s: float, setpoint: Array, authority: Authority) -> str:
        if authority.mode not in ARMED or not len(self._angles):
            self._following.forget()
            if authority.mode is not Mode.FAULT:
                self.evidence = None
            return ""
        angles = self._angles
        stuck = self._following.step(now_s, setpoint[angles], self._estimator.joints[angles])
        if stuck:
            self.evidence = self._estimator.conflict(wheels_spin=authority.wheels_spin)
        return stuck
