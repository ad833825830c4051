"""Monitors of the control loop that limit the speed, report events or raise faults."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from tsd_twin.control.state_estimator import NEUTRAL_RAD, StateEstimator
from tsd_twin.estimation import OUTAGE_S
from tsd_twin.lie import Array
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.events import Event
from tsd_twin.messages.modes import ARMED, LATCHED
from tsd_twin.messages.status import ConsistencyStatus
from tsd_twin.robots.description import Battery
from tsd_twin.safety import SafetySupervisor

_SATURATION_REPORT_S = 0.5


class SaturationMonitor:
    """Applied fraction of the requested twist, with rate-limited events."""

    def __init__(self) -> None:
        self.share = 1.0
        """Applied fraction of the latest request."""
        self._reported_s = -math.inf

    def compare(self, request: Array, capped: Array, now_s: float) -> Event | None:
        """Compare a requested twist (3,) with the capped one (3,); return an event or None."""
        # The twists differ only by a factor; maximum norms cannot overflow.
        length = _largest(request)
        self.share = _largest(capped) / length if length > 0.0 else 1.0
        if self.share >= 0.999 or now_s - self._reported_s < _SATURATION_REPORT_S:
            return None
        self._reported_s = now_s
        return Event.of(
            "clamp",
            because(Code.LIMITED, percent=100.0 * self.share),
            "limits of speed, turn rate and tilt",
            now_s,
            requested=request.tolist(),
            applied=capped.tolist(),
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
        """Factor on the speed and turn-rate limits."""
        self.why: Reason | None = None
        """Reason for a factor below 1, or None."""
        self._battery = battery
        self._low_since_s: float | None = None

    def step(self, volts: float | None, now_s: float, *, armed: bool) -> Event | None:
        """Update with a voltage; return an event if the limits change, or None."""
        warn_v = self._battery.warn_v
        if volts is None or math.isnan(volts):
            return None
        if volts >= warn_v:
            self._low_since_s = None
            if self.why is None or armed or volts <= warn_v + _CHARGED_V:
                return None
            self.share, self.why = 1.0, None
            return self._event(because(Code.BATTERY_CHARGED, volts=volts), now_s)
        self._low_since_s = now_s if self._low_since_s is None else self._low_since_s
        if self.why is not None or now_s - self._low_since_s < _LOW_S:
            return None
        self.share = self._battery.low_speed_share
        self.why = because(Code.BATTERY_LOW, volts=warn_v)
        return self._event(because(Code.SLOWED, self.why, percent=100.0 * self.share), now_s)

    @staticmethod
    def _event(why: Reason, now_s: float) -> Event:
        return Event.of("battery", why, "limits with a low battery", now_s)


WARM_MARGIN_C, HOT_MARGIN_C = 15.0, 10.0
"""Margins below the temperature at which servos switch off, for a warning and for slowing down. The
board or the bridge stops the robot at 5 °C."""


class HeatMonitor:
    """Fraction of the speed limits allowed by the servo temperature.

    It recovers only while disarmed and below the temperature of the warning. Missing temperatures
    (None or NaN) are ignored.
    """

    def __init__(self, share_when_hot: float, limit_c: float) -> None:
        """`limit_c` is the temperature at which servos switch off."""
        self._warm_c, self._hot_c = limit_c - WARM_MARGIN_C, limit_c - HOT_MARGIN_C
        self.share = 1.0
        """Factor on the speed and turn-rate limits."""
        self.why: Reason | None = None
        """Reason for a factor below 1, or None."""
        self._share_when_hot = share_when_hot
        self._warm = False

    def step(self, hottest_c: float | None, now_s: float, *, armed: bool) -> Event | None:
        """Update with the hottest servo; return an event on a change, or None."""
        if hottest_c is None or math.isnan(hottest_c):
            return None
        if hottest_c < self._warm_c:
            if armed or not self._warm:
                return None
            self.share, self.why, self._warm = 1.0, None, False
            return self._event(because(Code.SERVOS_COOLED), now_s)
        if hottest_c >= self._hot_c and self.why is None:
            self.share, self._warm = self._share_when_hot, True
            self.why = because(Code.SERVO_HOT, limit_c=self._hot_c)
            return self._event(because(Code.SLOWED, self.why, percent=100.0 * self.share), now_s)
        if self._warm:
            return None
        self._warm = True
        return self._event(because(Code.SERVO_WARM, celsius=hottest_c, limit_c=self._hot_c), now_s)

    @staticmethod
    def _event(why: Reason, now_s: float) -> Event:
        return Event.of("heat", why, "limits with hot servos", now_s)


def _largest(twist: Array) -> float:
    return max(map(abs, twist.tolist()))


_REPORT_S = 1.0
_ALIKE = 0.9
"""Contribution to a contradiction, relative to the largest, above which an actuator may be it."""


class FaultReporter:
    """Rate-limited events about the actuator suspected by the consistency test."""

    def __init__(self) -> None:
        self._last: str | None = None
        self._reported_s = -math.inf

    def step(self, consistency: ConsistencyStatus, now_s: float) -> Event | None:
        """Return an event if the suspected actuator changes, or None.

        If several explain the contradiction equally well, none is suspected.
        """
        if consistency.level <= 1.0:
            return None
        name = consistency.suspect
        if name is not None:
            why = because(Code.ACTUATOR_SUSPECT, actuator=name)
        else:
            most = max(consistency.contributions.values())
            alike = [
                each for each, share in consistency.contributions.items() if share > _ALIKE * most
            ]
            name = ", ".join(alike)
            why = because(Code.ACTUATORS_CONTRADICT, actuators=name)
        if name == self._last or now_s - self._reported_s < _REPORT_S:
            return None
        self._last, self._reported_s = name, now_s
        return Event.of("consistency", why, "consistency monitor", now_s)


ASIDE_RAD = NEUTRAL_RAD
"""Maximum following error: the neutral tolerance of arming, above the droop of a loaded servo."""
REMEMBERED_S = 0.3
"""Time window of past setpoints for comparison with the measured angle."""
FOLLOWING_ERROR_TIMEOUT_S = 0.7
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

    def step(self, now_s: float, commanded: Array, measured: Array) -> Reason | None:
        """Return the joint with a persistent error and its size, or None.

        `commanded` (k,) and `measured` (k,) are angles in radians; non-finite values are ignored.
        """
        while self._commanded and now_s - self._commanded[0][0] > REMEMBERED_S:
            self._commanded.popleft()
        self._commanded.append((now_s, commanded))
        if not any(abs(off) > ASIDE_RAD for off in (measured - commanded).tolist()):
            self._since_s = None
            return None
        lately = np.array([angles for _, angles in self._commanded])
        nearest = np.clip(measured, lately.min(axis=0), lately.max(axis=0))
        aside = np.abs(measured - nearest) > ASIDE_RAD
        if self._since_s is None:
            self._since_s = np.full(len(commanded), np.inf)
        self._since_s = np.where(aside, np.minimum(self._since_s, now_s), np.inf)
        worst = int(np.argmin(self._since_s))
        if now_s - self._since_s[worst] < FOLLOWING_ERROR_TIMEOUT_S:
            return None
        off_deg = float(np.degrees(measured[worst] - commanded[worst]))
        return because(Code.FOLLOWING_ERROR, joint=self._names[worst], deg=off_deg)


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

    def step(
        self, now_s: float, setpoint: Array, supervisor: SafetySupervisor, fault: Reason | None
    ) -> Reason | None:
        """Return the reason for a fault, or None; `fault` is reported by the board.

        `setpoint` (n,) is the last one sent to the joints.
        """
        if fault is None and self.silent(now_s):
            fault = self._why_silent(now_s, supervisor)
        return fault or self._stuck(now_s, setpoint, supervisor)

    def _why_silent(self, now_s: float, supervisor: SafetySupervisor) -> Reason:
        busy = supervisor.loop.explains(self._estimator.measured_s, SILENT_S, now_s)
        if busy is None:
            return because(Code.JOINTS_SILENT, ms=1000.0 * SILENT_S)
        return because(Code.JOINTS_SILENT_LOOP_LATE, ms=busy.params["ms"])

    def _stuck(self, now_s: float, setpoint: Array, supervisor: SafetySupervisor) -> Reason | None:
        if supervisor.mode not in ARMED or not len(self._angles):
            self._following_error.forget()
            if supervisor.mode not in LATCHED:
                self.evidence = None
            return None
        angles = self._angles
        stuck = self._following_error.step(now_s, setpoint[angles], self._estimator.joints[angles])
        if stuck is not None:
            self.evidence = self._estimator.consistency(wheels_spin=supervisor.wheels_spin)
        return stuck
