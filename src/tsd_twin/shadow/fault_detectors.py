"""Sequential fault tests of a shadow twin: slow servos and a low battery."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import numpy.typing as npt

from tsd_twin.lie import Array
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.sentences import full_sentence
from tsd_twin.robots import RobotDescription

SLOW_SERVO = 0.30
"""Fractional speed loss of a servo that is tested for. Less than half of it is never reported."""
LOW_BATTERY = 0.05
"""The same for the battery, as a fraction of the nominal voltage."""
_EVIDENCE, _SERVO_EVIDENCE = 12.0, 16.0
"""Log-likelihood ratio at which a battery and a servo fault is reported. Healthy robots reach 13 on
servos at full stick, whose errors are correlated for some seconds."""
_SUSPICION = 2.0
"""Evidence above which a test stops adapting to the robot, because it would learn the fault."""


class Drift(msgspec.Struct, frozen=True):
    """A part that differs from its description or from its earlier behaviour."""

    part: str
    """Joint, `wheels` for all wheels, `battery`, or "" if the part is not known."""
    why: Reason
    """Code and parameters of the difference."""

    @property
    def text(self) -> str:
        """The difference as an English sentence."""
        return full_sentence(self.why)


class JointComparison(msgspec.Struct, frozen=True):
    """Measured and simulated value of a joint, and the tolerance band of their difference."""

    name: str
    unit: str
    measured: float | None
    """Null if not measured."""
    simulated: float
    band: float
    """Largest difference explained by the described errors, in either direction."""
    inside: bool


class PoseComparison(msgspec.Struct, frozen=True):
    """Measured minus simulated motion in the last second, in the axes at its start."""

    names: tuple[str, str, str]
    units: tuple[str, str, str]
    difference: tuple[float, float, float]
    band: tuple[float, float, float]
    inside: bool


class ShadowReport(msgspec.Struct, frozen=True):
    """Comparison of a robot with its shadow twin at one time."""

    compared_s: float
    """Duration of the comparison without a gap."""
    joints: tuple[JointComparison, ...] = ()
    pose: PoseComparison | None = None
    """Null during the first second of comparison."""
    drifts: tuple[Drift, ...] = ()
    note: Reason | None = None
    """Reason why some test is not possible."""


class _Cusum:
    """Cumulative sums of log-likelihood ratios, one per fault."""

    def __init__(self, faults: int, threshold: float) -> None:
        self.sums = np.zeros(faults)
        self._threshold = threshold

    def add(self, ratios: Array) -> None:
        """Add log-likelihood ratios (faults,), clamping sums between 0 and twice the threshold."""
        self.sums = np.clip(self.sums + ratios, 0.0, 2.0 * self._threshold)

    @property
    def named(self) -> npt.NDArray[np.bool_]:
        """(faults,): whether the evidence reaches the threshold."""
        return self.sums >= self._threshold


_SHARED_S, _OWN_S = 5.0, 60.0
"""Memory of the common lag of all servos, and of each servo's own lag."""
_SHARED_LAG_S, _OWN_LAG_S = 0.01, 0.003
"""Standard deviation of the common lag, and of a servo's lag relative to the others."""
_MAX_OWN_LAG_S = 0.002
_MAX_DEFLECTION = 1.5
"""Maximum deflection relative to the model: from 0 (no load) to 1 (modelled floor)."""
_EXTRA_COMPLIANCE = SLOW_SERVO / (1.0 - SLOW_SERVO)
"""Additional relative deflection of a slow servo."""
_ASSUMED_MPS2 = 3.0
"""Assumed acceleration that deflects the servos, until their compliance is learned."""
_OFFSET_S = 2.0
"""Time constant of the mean difference, for a servo under sustained load or within its dead
band."""
_BLOCK_S = 0.3
"""Angle errors are correlated for a while; sums over this time are treated as independent."""
_KNOWN_BLOCKS, _MAX_BLOCKS = 10.0, 120.0
"""Weight of the described noise in blocks, and number of blocks after which older ones are
discounted."""
_MIN_BLOCKS = 7.0
"""Number of blocks used to learn the noise before a fault can be reported."""
_MAX_RATIO, _MAX_SERVO_RATIO = 4.0, 6.0
"""Maximum contribution of a block: a single block never triggers a report, nor do two of a
servo."""
_MIN_DIFFERENCE_RAD, _MIN_BACKLASH_FRACTION = math.radians(0.006), 0.2
"""Minimum RMS difference between slow and healthy servo in a useful block: absolute, and as a
fraction of the backlash, which delays slow motions more than a slow servo does."""
_SERVO_MODEL_SHARE = 0.15
"""Standard deviation of the lag's model error, as a fraction of the fault."""


class ServoTest:
    """Tests for servos that have become slower, from the angles they report.

    Bus delays, backlash and loads make all servos lag, so each servo's lag is compared with the
    other servos and with its own past. The effect of noise and backlash on the sums is learned.
    """

    def __init__(self, robot: RobotDescription, names: list[str]) -> None:
        self._names = names
        errors, gives = robot.joint_errors(), robot.joint_compliance()
        self._backlash_rad = 0.0 if gives is None else gives.backlash_rad
        dead_band_rad = 0.0 if gives is None else gives.dead_band_rad
        step_rad = math.sqrt(12.0) * errors.angle_rad
        self._floor2 = errors.angle_rad**2 + step_rad**2 / 6.0
        self._delay_s = 2.0 * robot.delay_s
        self._still_rad = math.hypot(3.0 * math.sqrt(self._floor2), dead_band_rad)
        count = len(names)
        self._cusum = _Cusum(count, _SERVO_EVIDENCE)
        load_rad = 0.0
        if gives is not None:
            load_rad = float(np.abs(gives.by_acceleration[:, :2]).max()) * _ASSUMED_MPS2
        known2 = self._floor2 + dead_band_rad**2 + (0.25 * self._backlash_rad) ** 2 + load_rad**2
        self._noise2 = np.full(count, known2)
        self._means = np.zeros((2, count))
        self._blocks = np.full(count, _KNOWN_BLOCKS)
        self._shared = np.zeros((5, count))
        self._own, self._size = np.zeros((2, count)), np.zeros((2, count))
        self.restart(np.zeros(count))

    def restart(self, nominal: Array) -> None:
        """Begin a block at the simulated angles (m,)."""
        self._before = nominal
        self._block, self._samples, self._block_s = np.zeros((2, len(self._names))), 0, 0.0

    def add(
        self,
        measured: Array,
        nominal: Array,
        slow: Array,
        lean: Array,
        dt_s: float,
        *,
        warm: bool,
    ) -> None:
        """Add measured angles (m,), with simulated angles of a healthy robot and of slow servos.

        `lean` (m,) is the deflection of a healthy robot's servos under its acceleration.
        """
        rate, self._before = (nominal - self._before) / dt_s, nominal
        if not warm or not np.isfinite(measured).all():
            return
        shared, yields = self._predict_from_others(measured - nominal, rate, lean, dt_s)
        error = measured - nominal - yields * lean
        fault = slow - nominal + _EXTRA_COMPLIANCE * yields * lean
        weight, push = self._own
        own = push / (weight + self._floor2 / _OWN_LAG_S**2)
        left = error + (shared + np.clip(own, -_MAX_OWN_LAG_S, _MAX_OWN_LAG_S)) * rate
        # Remove the mean from the fault too, so that it is weighted as it would appear.
        self._means += dt_s / _OFFSET_S * (np.array([left, fault]) - self._means)
        left, fault = left - self._means[0], fault - self._means[1]
        calm = self._cusum.sums < _SUSPICION
        self._own *= 1.0 - dt_s / _OWN_S
        self._own += calm * np.array([rate**2, -(error + shared * rate) * rate])
        self._block += [fault**2, left * fault]
        self._samples += 1
        self._block_s += dt_s
        if self._block_s >= _BLOCK_S - 1e-6:
            self._judge(calm)
            self.restart(nominal)

    def _judge(self, calm: npt.NDArray[np.bool_]) -> None:
        """Add the evidence of a block."""
        (strength, match), count = self._block, self._samples
        tells = (
            strength
            > count * max(_MIN_DIFFERENCE_RAD, _MIN_BACKLASH_FRACTION * self._backlash_rad) ** 2
        )
        noise2 = np.maximum(self._noise2, np.median(self._noise2))
        noise2 = noise2 + _SERVO_MODEL_SHARE**2 * strength
        ratios = (match - 0.5 * strength) / noise2
        ready = self._blocks >= _KNOWN_BLOCKS + _MIN_BLOCKS
        self._cusum.add(ready * tells * np.clip(ratios, -3.0, _MAX_SERVO_RATIO))
        self._size = np.where(self._cusum.sums > 0.0, self._size + self._block, 0.0)
        learns = tells & calm
        self._blocks = np.minimum(self._blocks + learns, _MAX_BLOCKS)
        seen = np.minimum(match**2 / np.maximum(strength, 1e-12), 9.0 * self._noise2)
        self._noise2 += learns * (seen - self._noise2) / self._blocks
        self._noise2 = np.maximum(self._noise2, self._floor2)

    def _predict_from_others(
        self, error: Array, rate: Array, lean: Array, dt_s: float
    ) -> tuple[Array, Array]:
        """Return the lag (m,) in seconds and relative deflection (m,) of the other servos.

        Leave-one-out least squares: each servo is predicted from all others.
        """
        self._shared *= 1.0 - dt_s / _SHARED_S
        self._shared += [rate**2, -rate * lean, lean**2, -error * rate, error * lean]
        others = self._shared.sum(axis=1, keepdims=True) - self._shared
        rate2, both, lean2, by_rate, by_lean = others
        rate2 = rate2 + self._floor2 / _SHARED_LAG_S**2
        lean2 = lean2 + self._floor2
        determinant = rate2 * lean2 - both**2
        lag = (lean2 * by_rate - both * by_lean) / determinant
        yields = (rate2 * by_lean - both * by_rate) / determinant
        return lag, np.clip(yields, 0.0, _MAX_DEFLECTION)

    def bands(self, rate: Array) -> Array:
        """Return the bands (m,), radians, of servos that turn at `rate` (m,), rad/s."""
        moves = np.minimum(np.abs(rate) * 0.02, 0.5 * self._backlash_rad)
        return self._still_rad + self._delay_s * np.abs(rate) + moves

    def drifts(self) -> list[Drift]:
        """Return the servos that have become slower."""
        found: list[Drift] = []
        for i in np.flatnonzero(self._cusum.named):
            share = SLOW_SERVO * float(self._size[1, i] / max(self._size[0, i], 1e-12))
            name = self._names[i]
            why = because(Code.SERVO_SLOWER, joint=name, percent=100.0 * share)
            found.append(Drift(name, why))
        return found


_BATTERY_SHARE = 0.03
"""Standard deviation of a charged battery's voltage, relative to the nominal voltage."""
_LEARNED = 40
"""Number of statuses (20 per second) that determine the initial voltage."""


class BatteryTest:
    """Tests for a low battery, relative to its initial or described voltage."""

    def __init__(self, nominal_v: float) -> None:
        self._nominal_v = nominal_v
        self._cusum = _Cusum(1, _EVIDENCE)
        self._count, self._start = 0, 0.0
        self.share = 1.0
        """Latest voltage relative to the nominal voltage."""

    def add(self, volts: float) -> None:
        """Add a measured voltage."""
        self.share = volts / self._nominal_v
        if self._count < _LEARNED:
            self._count += 1
            self._start += (self.share - 1.0 - self._start) / self._count
        start = float(np.clip(self._start, -2.0 * _BATTERY_SHARE, 2.0 * _BATTERY_SHARE))
        lost = 1.0 + start - self.share
        ratio = 0.05 * (lost - 0.5 * LOW_BATTERY) * LOW_BATTERY / 0.01**2
        self._cusum.add(np.clip(np.array([ratio]), -1.0, 1.0))

    def drifts(self) -> list[Drift]:
        """Return the battery if its voltage is low."""
        if not self._cusum.named[0]:
            return []
        volts = self.share * self._nominal_v
        was = self._nominal_v * max(1.0, 1.0 + self._start)
        return [Drift("battery", because(Code.BATTERY_LOWER, volts=volts, lost=was - volts))]
