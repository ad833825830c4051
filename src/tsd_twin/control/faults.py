"""Monitors of the control loop that limit the speed, report events or raise faults."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from tsd_twin.control.state_estimator import NEUTRAL_RAD, StateEstimator
from tsd_twin.estimation import OUTAGE_S
from tsd_twin.lie import Array
from tsd_twin.messages.requests import Event
from tsd_twin.messages.status import ConsistencyStatus
from tsd_twin.robots.description import Battery
from tsd_twin.safety import ARMED, LATCHED, SafetySupervisor

_SATURATION_REPORT_S = 0.5


class SaturationMonitor:
    """Applied fraction of the requested twist, with rate-limited events."""

    def __init__(self) -> None:
        self.share = 1.0
        """Applied fraction of the latest request."""
        self._reported_s = -math.inf

    def forget(self) -> None:
        """Reset, because there is no request."""
        self.share = 1.0

    def compare(self, request: Array, capped: Array, now_s: float) -> Event | None:
        """Compare a requested twist (3,) with the capped one (3,); return an event or None."""
        # The twists differ only by a factor; maximum norms cannot overflow.
        length = _largest(request)
        self.share = _largest(capped) / length if length > 0.0 else 1.0
        if self.share >= 0.999 or now_s - self._reported_s < _SATURATION_REPORT_S:
            return None
        self._reported_s = now_s
        return Event(
            "clamp",
            f"The limits let {100 * self.share:.0f} % of the command through.",
            requested=request.tolist(),
            applied=capped.tolist(),
            rule="limits of speed, turn rate and tilt",
            robot_s=now_s,
        )


_LOW_S = 1.0
"""Longer than the voltage drop of a starting motor; same as on the board."""
_CHARGED_V = 0.3
"""Voltage rise of an unchanged battery when its load is removed."""


class BatteryMonitor:
    """Fraction of the speed limits allowed by the battery, reduced after a sustained low voltage.

    It recovers only while disarmed, so that no robot speeds up while driving. Missing voltages
    (None or NaN) are ignored.
    """

    def __init__(self, battery: Battery) -> None:
        self.share = 1.0
        """Share of the limits of speed and turn rate."""
        self.reason = ""
        """Reason why it is less than 1; else empty."""
        self._battery = battery
        self._low_since_s: float | None = None

    def step(self, volts: float | None, now_s: float, *, armed: bool) -> Event | None:
        """Update with a voltage; return an event if the limits change, or None."""
        warn_v = self._battery.warn_v
        if volts is None or math.isnan(volts):
            return None
        if volts >= warn_v:
            self._low_since_s = None
            if not self.reason or armed or volts <= warn_v + _CHARGED_V:
                return None
            self.share, self.reason = 1.0, ""
            return self._event(f"The battery has {volts:.1f} V: the robot drives as usual.", now_s)
        self._low_since_s = now_s if self._low_since_s is None else self._low_since_s
        if self.reason or now_s - self._low_since_s < _LOW_S:
            return None
        self.share = self._battery.low_speed_share
        self.reason = f"the battery is low: below {warn_v:g} V"
        percent = f"{100.0 * self.share:.0f} %"
        return self._event(f"T{self.reason[1:]}. The speed limit is {percent} of the usual.", now_s)

    @staticmethod
    def _event(text: str, now_s: float) -> Event:
        return Event("battery", text, rule="limits with a low battery", robot_s=now_s)


WARM_C, HOT_C = 65.0, 70.0
"""Servo temperatures for a warning and for slowing down. The board stops the robot at 75 °C, and
servos switch off at 80 °C."""


class HeatMonitor:
    """Fraction of the speed limits allowed by the servo temperature.

    It recovers only while disarmed and below `WARM_C`. Missing temperatures (None or NaN) are
    ignored.
    """

    def __init__(self, share_when_hot: float) -> None:
        self.share = 1.0
        """Share of the limits of speed and turn rate."""
        self.reason = ""
        """Reason why it is less than 1; else empty."""
        self._share_when_hot = share_when_hot
        self._warm = False

    def step(self, hottest_c: float | None, now_s: float, *, armed: bool) -> Event | None:
        """Update with the hottest servo; return an event on a change, or None."""
        if hottest_c is None or math.isnan(hottest_c):
            return None
        if hottest_c < WARM_C:
            if armed or not self._warm:
                return None
            self.share, self.reason, self._warm = 1.0, "", False
            return self._event("The servos have cooled: the robot drives as usual.", now_s)
        if hottest_c >= HOT_C and not self.reason:
            self.share, self._warm = self._share_when_hot, True
            self.reason = f"a servo is hot: above {HOT_C:g} °C"
            percent = f"{100.0 * self.share:.0f} %"
            text = f"A{self.reason[1:]}. The speed limit is {percent} of the usual."
            return self._event(text, now_s)
        if self._warm:
            return None
        self._warm = True
        text = f"A servo has {hottest_c:.0f} °C: at {HOT_C:g} °C the robot slows down."
        return self._event(text, now_s)

    @staticmethod
    def _event(text: str, now_s: float) -> Event:
        return Event("heat", text, rule="limits with hot servos", robot_s=now_s)


def _largest(twist: Array) -> float:
    return max(map(abs, twist.tolist()))


_REPORT_S = 1.0


class FaultReporter:
    """Rate-limited events about the actuator suspected by the consistency test."""

    def __init__(self) -> None:
        self._last: str | None = None
        self._reported_s = -math.inf

    def step(self, suspect: str | None, now_s: float) -> Event | None:
        """Return an event if the suspected actuator changes, or None."""
        if suspect in (None, self._last) or now_s - self._reported_s < _REPORT_S:
            return None
        self._last, self._reported_s = suspect, now_s
        text = f"{suspect} contradicts the others."
        return Event("consistency", text, rule="consistency monitor", robot_s=now_s)


ASIDE_RAD = NEUTRAL_RAD
"""Maximum following error: the neutral tolerance of arming, above the droop of a loaded servo."""
REMEMBERED_S = 0.3
"""Time window of past setpoints for comparison with the measured angle."""
PATIENCE_S = 0.7
"""Maximum duration of a following error; a stuck gimbal is detected within 1 s."""


class FollowingErrorMonitor:
    """Following error of joints relative to recent setpoints, so that lag is not a fault."""

    def __init__(self, names: Sequence[str]) -> None:
        """Monitor the joints with these names, in this order."""
        self._names = names
        self._commanded: deque[tuple[float, Array]] = deque()
        self._since_s: Array | None = None

    def forget(self) -> None:
        """Reset, because no setpoint is active."""
        self._commanded.clear()
        self._since_s = None

    def step(self, now_s: float, commanded: Array, measured: Array) -> str:
        """Text with the joint whose error lasts too long and its size; "" if none does.

        `commanded` (k,) and `measured` (k,) are angles in radians; values not finite are ignored.
        """
        while self._commanded and now_s - self._commanded[0][0] > REMEMBERED_S:
            self._commanded.popleft()
        self._commanded.append((now_s, commanded))
        if not any(abs(off) > ASIDE_RAD for off in (measured - commanded).tolist()):
            self._since_s = None
            return ""
        lately = np.array([angles for _, angles in self._commanded])
        nearest = np.clip(measured, lately.min(axis=0), lately.max(axis=0))
        aside = np.abs(measured - nearest) > ASIDE_RAD
        if self._since_s is None:
            self._since_s = np.full(len(commanded), np.inf)
        self._since_s = np.where(aside, np.minimum(self._since_s, now_s), np.inf)
        worst = int(np.argmin(self._since_s))
        if now_s - self._since_s[worst] < PATIENCE_S:
            return ""
        off_deg = float(np.degrees(measured[worst] - commanded[worst]))
        return f"{self._names[worst]} does not follow: it is {off_deg:+.1f}° from its set-point"


SILENT_S = OUTAGE_S
"""While armed, joints unmeasured for this long are a fault."""


class JointFaultMonitor:
    """Joint faults: missing measurements and following errors of gimbals."""

    def __init__(self, estimator: StateEstimator) -> None:
        self._estimator = estimator
        self._angles = np.flatnonzero(estimator.is_angle)
        self._following_error = FollowingErrorMonitor(
            [estimator.kinematics.joints[i].name for i in self._angles]
        )
        self.evidence: ConsistencyStatus | None = None
        """Consistency result when a gimbal stuck; kept in the status until the reset."""

    def silent(self, now_s: float) -> bool:
        """Return whether joint measurements are missing for too long."""
        return now_s - self._estimator.measured_s > SILENT_S

    def step(self, now_s: float, setpoint: Array, supervisor: SafetySupervisor, fault: str) -> str:
        """Text of the fault, "" if there is none; `fault` is the one the board reports.

        `setpoint` (n,) is the last one commanded to the joints.
        """
        if self.silent(now_s) and not fault:
            busy = supervisor.loop.explains(self._estimator.measured_s, SILENT_S, now_s)
            why = f", since {busy}" if busy else f" for {SILENT_S * 1000:.0f} ms"
            fault = f"the joints have not been measured{why}"
        return fault or self._stuck(now_s, setpoint, supervisor)

    def _stuck(self, now_s: float, setpoint: Array, supervisor: SafetySupervisor) -> str:
        if supervisor.mode not in ARMED or not len(self._angles):
            self._following_error.forget()
            if supervisor.mode not in LATCHED:
                self.evidence = None
            return ""
        angles = self._angles
        stuck = self._following_error.step(now_s, setpoint[angles], self._estimator.joints[angles])
        if stuck:
            self.evidence = self._estimator.consistency(wheels_spin=supervisor.wheels_spin)
        return stuck
