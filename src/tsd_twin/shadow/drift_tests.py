"""Sequential tests of a shadow twin: slow servos, slow wheels and a battery that sags; and its
report.
"""

from __future__ import annotations

import math

import msgspec
import numpy as np
import numpy.typing as npt

from tsd_twin.lie import Array
from tsd_twin.robots import RobotDescription

SLOW_SERVO = 0.30
"""Share of its speed that a servo has lost: the fault that is looked for. Less than half of it
is never named."""
SLOW_WHEEL = 0.05
"""The same of a wheel; less than half of it is never named."""
LOW_BATTERY = 0.05
"""The same of the battery, as a share of the nominal voltage."""
_EVIDENCE, _SERVO_EVIDENCE, _WHEEL_EVIDENCE = 12.0, 16.0, 10.0
"""Logarithm of the likelihood ratio at which a battery, a servo and a wheel are named. Where the
noise is as modelled, the mean time to a false name is more than exp(10) blocks of half a second,
three hours, for each test (Lorden 1971). Sound robots reach 6.5 on wheels; and 13 on servos at full
stick, whose errors are alike for some seconds."""
_SUSPICION = 2.0
"""Evidence above which a test no longer adapts to the robot: it would learn the fault."""
_MARGIN = 3.0
"""Evidence by which a wheel must be ahead of another, to be named alone."""
_MARGIN_SHARE = 0.25
"""The same, as a share of its own evidence: wheels and floor are less simple than their model."""


class Drift(msgspec.Struct, frozen=True):
    """A part that differs from its description, or from how it was before."""

    part: str
    """Joints, separated by commas; `wheels` for all of them, or `battery`."""
    text: str
    """One sentence."""


class JointComparison(msgspec.Struct, frozen=True):
    """Measured and simulated value of a joint, and the band of their difference."""

    name: str
    unit: str
    measured: float | None
    """Null where it is not measured."""
    simulated: float
    band: float
    """Largest difference that the errors of the description explain, to either side."""
    inside: bool


class PoseComparison(msgspec.Struct, frozen=True):
    """Measured minus simulated motion in the last second, along the axes at its start."""

    names: tuple[str, str, str]
    units: tuple[str, str, str]
    difference: tuple[float, float, float]
    band: tuple[float, float, float]
    inside: bool


class ShadowReport(msgspec.Struct, frozen=True):
    """Comparison of a robot with its shadow twin at one time."""

    compared_s: float
    """For how long they have been compared without a gap."""
    joints: tuple[JointComparison, ...] = ()
    pose: PoseComparison | None = None
    """Null until they have been compared for a second."""
    drifts: tuple[Drift, ...] = ()
    note: str = ""
    """What cannot be tested, and why; "" if all can."""


def _spoken(joint: str) -> str:
    """Return `module2_alpha` as a person says it: `module 2 alpha`."""
    head, _, part = joint.partition("_")
    name = head.rstrip("0123456789")
    return " ".join(filter(None, [name, head[len(name) :], part]))


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


class _Cusum:
    """Cumulative sums of log-likelihood ratios, one for each fault."""

    def __init__(self, faults: int, threshold: float) -> None:
        self.sums = np.zeros(faults)
        self._threshold = threshold

    def add(self, ratios: Array) -> None:
        """Add log-likelihood ratios (faults,); sums stay between 0 and twice the threshold."""
        self.sums = np.clip(self.sums + ratios, 0.0, 2.0 * self._threshold)

    @property
    def named(self) -> npt.NDArray[np.bool_]:
        """(faults,): whether there is enough evidence."""
        return self.sums >= self._threshold


_SHARED_S, _OWN_S = 5.0, 60.0
"""Memory of the lag of all servos, and of each one."""
_SHARED_LAG_S, _OWN_LAG_S = 0.01, 0.003
"""Standard deviation of the lag of all servos, and of one from that of the others."""
_MOST_OWN_LAG_S = 0.002
_MOST_LEAN = 1.5
"""Largest share of the reckoned lean: it is 0 without loads, and 1 on the reckoned floor."""
_SOFTER = SLOW_SERVO / (1.0 - SLOW_SERVO)
"""By how much more a slow servo gives way, as a share."""
_USUAL_MPS2 = 3.0
"""Acceleration for which servos give way, until it is learned how much they do."""
_OFFSET_S = 2.0
"""Memory of the mean difference, of a servo under a load that lasts or within its dead band."""
_BLOCK_S = 0.3
"""Errors of angles are alike for a while: their sums over this are taken for independent."""
_KNOWN_BLOCKS, _MOST_BLOCKS = 10.0, 120.0
"""Blocks that the noise of the description counts for, and after which older ones count less."""
_LEAST_BLOCKS = 7.0
"""Blocks from which the noise is learned before anything is named."""
_MOST_RATIO, _MOST_SERVO_RATIO = 4.0, 6.0
"""Most that a block counts: a single one names nothing, nor do two blocks of a servo."""
_LEAST_RAD, _LEAST_PLAY = math.radians(0.006), 0.2
"""Root mean square by which a slow servo must be behind a sound one in a block that counts; and the
same as a share of the play, which holds up slow motions more than a slow servo does."""
_SERVO_MODEL_SHARE = 0.15
"""Standard deviation of the lag that the model of a servo has wrong, as a share of the fault."""


class ServoTest:
    """Test for servos that got slower, by the angles that they report.

    Delays of the bus, play and loads let all servos lag; so the lag of each one is compared with
    that of the others, and with its own from before. What noise and play do to the sums is learned.
    """

    def __init__(self, robot: RobotDescription, names: list[str]) -> None:
        self._names = names
        errors, gives = robot.joint_errors(), robot.joint_compliance()
        self._play_rad = 0.0 if gives is None else gives.play_rad
        dead_band_rad = 0.0 if gives is None else gives.dead_band_rad
        step_rad = math.sqrt(12.0) * errors.angle_rad
        self._floor2 = errors.angle_rad**2 + step_rad**2 / 6.0
        self._delay_s = 2.0 * robot.delay_s
        self._still_rad = math.hypot(3.0 * math.sqrt(self._floor2), dead_band_rad)
        count = len(names)
        self._cusum = _Cusum(count, _SERVO_EVIDENCE)
        load_rad = 0.0
        if gives is not None:
            load_rad = float(np.abs(gives.by_acceleration[:, :2]).max()) * _USUAL_MPS2
        known2 = self._floor2 + dead_band_rad**2 + (0.25 * self._play_rad) ** 2 + load_rad**2
        self._noise2 = np.full(count, known2)
        self._means = np.zeros((2, count))
        self._blocks = np.full(count, _KNOWN_BLOCKS)
        self._shared = np.zeros((5, count))
        self._own, self._size = np.zeros((2, count)), np.zeros((2, count))
        self._block, self._samples, self._block_s = np.zeros((2, count)), 0, 0.0
        self._before = np.zeros(count)

    def restart(self, nominal: Array) -> None:
        """Begin anew with the simulated angles (m,)."""
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
        """Add measured angles (m,), and those of a sound robot and of one with slow servos.

        `lean` (m,) is by how much the servos of a sound robot give way to its acceleration.
        """
        rate, self._before = (nominal - self._before) / dt_s, nominal
        if not warm or not np.isfinite(measured).all():
            return
        shared, yields = self._shared_by_others(measured - nominal, rate, lean, dt_s)
        error = measured - nominal - yields * lean
        fault = slow - nominal + _SOFTER * yields * lean
        weight, push = self._own
        own = push / (weight + self._floor2 / _OWN_LAG_S**2)
        left = error + (shared + np.clip(own, -_MOST_OWN_LAG_S, _MOST_OWN_LAG_S)) * rate
        # Without what lasts; the fault in the same way, so that it is weighed as it would show.
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
            self._block, self._samples, self._block_s = np.zeros_like(self._block), 0, 0.0

    def _judge(self, calm: npt.NDArray[np.bool_]) -> None:
        """Weigh the sums of a block."""
        (strength, match), count = self._block, self._samples
        tells = strength > count * max(_LEAST_RAD, _LEAST_PLAY * self._play_rad) ** 2
        noise2 = np.maximum(self._noise2, np.median(self._noise2))
        noise2 = noise2 + _SERVO_MODEL_SHARE**2 * strength
        ratios = (match - 0.5 * strength) / noise2
        ready = self._blocks >= _KNOWN_BLOCKS + _LEAST_BLOCKS
        self._cusum.add(ready * tells * np.clip(ratios, -3.0, _MOST_SERVO_RATIO))
        self._size = np.where(self._cusum.sums > 0.0, self._size + self._block, 0.0)
        learns = tells & calm
        self._blocks = np.minimum(self._blocks + learns, _MOST_BLOCKS)
        seen = np.minimum(match**2 / np.maximum(strength, 1e-12), 9.0 * self._noise2)
        self._noise2 += learns * (seen - self._noise2) / self._blocks
        self._noise2 = np.maximum(self._noise2, self._floor2)

    def _shared_by_others(
        self, error: Array, rate: Array, lean: Array, dt_s: float
    ) -> tuple[Array, Array]:
        """Return the lag (m,), seconds, and the share of the lean (m,) that the other servos have.

        By least squares: what is known of all servos but one.
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
        return lag, np.clip(yields, 0.0, _MOST_LEAN)

    def bands(self, rate: Array) -> Array:
        """Bands (m,), radians, of servos that turn at `rate` (m,), rad/s."""
        moves = np.minimum(np.abs(rate) * 0.02, 0.5 * self._play_rad)
        return self._still_rad + self._delay_s * np.abs(rate) + moves

    def drifts(self) -> list[Drift]:
        """Return the servos that got slower."""
        found: list[Drift] = []
        for i in np.flatnonzero(self._cusum.named):
            share = SLOW_SERVO * float(self._size[1, i] / max(self._size[0, i], 1e-12))
            text = f"The servo of {_spoken(self._names[i])} follows {_percent(share)} slower."
            found.append(Drift(self._names[i], text))
        return found


_SUPPOSED = 0.6 * SLOW_WHEEL
"""Loss of the fault that is tested: the floor and the other wheels pull a slow wheel along, so that
down to half of what its motor lost is left of it."""
_SIZES = (0.6, 2.0)
"""Possible losses, over the one that is tested."""
_LEAST_LEFT, _LEAST_LEFT_EARLY = 0.1, 0.5
"""Share of the strength of a fault that is left, once the filter has learned the rest of it, below
which its test begins anew; and the same where there is no suspicion."""


class WheelTest:
    """Test for wheels that lost speed, by measured wheel speeds or by the motion of the robot.

    A Kalman filter estimates the loss of each wheel and nuisances, with the standard deviations of
    the description as their prior. A fault is a step of the losses. The filter of a robot with
    such a step would differ in its state alone, by what it has not learned of it yet: so evidence
    comes from innovations, and what the filter learns of a fault is taken off the fault.
    """

    def __init__(
        self, robot: RobotDescription, names: list[str], nuisances: Array | None = None
    ) -> None:
        """`nuisances` (n,) are standard deviations of numbers that are no losses."""
        self._names = names
        errors = robot.joint_errors()
        count = len(names)
        own, common = max(errors.spin_share, 0.002), errors.alike_spin_share
        sizes = np.zeros(0) if nuisances is None else nuisances
        self.prior: Array = own**2 * np.eye(count) + common**2
        """(k, k): covariance of the losses of sound wheels."""
        self._first2 = np.concatenate([np.diag(self.prior), sizes**2])
        self._state: Array = np.zeros(count + len(sizes))
        self._covariance = np.diag(self._first2)
        self._covariance[:count, :count] = self.prior
        self._faults = np.zeros((len(self._state), count + 1))
        self._faults[:count] = _SUPPOSED * np.column_stack([np.eye(count), np.ones(count)])
        self._left = self._faults.copy()
        self._cusum = _Cusum(count + 1, _WHEEL_EVIDENCE)
        self._size = np.zeros((2, count + 1))
        self._before = np.zeros(count + 1)

    def keep(self, shares: Array, dt_s: float) -> None:
        """Let time pass: `shares` (n,) of the nuisances are as before, the rest is new."""
        count = len(self._names)
        self._state[count:] *= shares
        self._left[count:] *= shares[:, None]
        self._covariance[count:] *= shares[:, None]
        self._covariance[:, count:] *= shares
        added = np.full(len(self._state), 2e-4**2 * dt_s)
        added[count:] = (1.0 - shares**2) * self._first2[count:]
        self._covariance += np.diag(added)

    def add(self, error: Array, rows: Array, noise: Array) -> None:
        """Add a difference (d,): `rows` (d, k + n) times the state, and noise.

        `noise` (d, d) is the covariance of the latter.
        """
        innovation = error - rows @ self._state
        crossed = rows @ self._covariance
        spread = crossed @ rows.T + noise
        shown = rows @ self._left
        weighed = np.linalg.solve(spread, shown).T
        strength = np.einsum("fd,df->f", weighed, shown)
        match = weighed @ innovation
        if len(error) == 1:
            strength[-1] = match[-1] = 0.0  # A turn cannot tell one wheel from all.
        was_named = self._cusum.named.any()
        self._cusum.add(np.clip(match - 0.5 * strength, -3.0, _MOST_RATIO))
        self._size = np.where(self._cusum.sums > 0.0, self._size + np.array([strength, match]), 0.0)
        if was_named:
            return  # What a named wheel lost is not learned: so its name is withdrawn on repair.
        gain = np.linalg.solve(spread, crossed).T
        self._state = self._state + gain @ innovation
        self._left = self._left - gain @ shown
        self._covariance = self._covariance - gain @ crossed
        new = rows @ self._faults
        most = np.einsum("df,df->f", np.linalg.solve(spread, new), new)
        sums = self._cusum.sums
        least = np.where(sums < _SUSPICION, _LEAST_LEFT_EARLY, _LEAST_LEFT) * most
        begins = ~self._cusum.named & ((sums <= 0.0) | (strength < least))
        self._cusum.sums = np.where(begins, 0.0, sums)
        self._size = np.where(begins, 0.0, self._size)
        self._left = np.where(begins, self._faults, self._left)
        lost = self._state[: len(self._names)]
        self._before = np.where(begins, np.append(lost, lost.mean()), self._before)

    def drifts(self) -> list[Drift]:
        """Return the wheels that lost speed."""
        every, named = len(self._names), self._cusum.named
        if not named.any():
            return []
        strength, match = self._size
        sizes = np.clip(match / np.maximum(strength, 1e-12), *_SIZES)
        ratios = sizes * (match - 0.5 * sizes * strength)
        ratios = np.where(self._cusum.sums > 0.0, ratios, -math.inf)
        best = int(np.where(named, ratios, -math.inf).argmax())
        share = _SUPPOSED * sizes + self._before
        margin = max(_MARGIN, _MARGIN_SHARE * ratios[best])
        alike = np.flatnonzero(ratios[:every] > ratios[best] - margin)
        if not len(alike):
            percent = _percent(float(share[every]))
            return [Drift("wheels", f"All wheels turn {percent} slower than their set-points.")]
        percent = _percent(float(share[alike].max()))
        said = " or ".join(_spoken(self._names[i].removesuffix("_wheel")) for i in alike)
        # Joints such as `wheel3` have the word in their names.
        is_named = any(self._names[i].startswith("wheel") for i in alike)
        said = said[0].upper() + said[1:] if is_named else f"The wheel of {said}"
        text = f"{said} turns {percent} slower than its set-point."
        return [Drift(",".join(self._names[i] for i in alike), text)]


_BATTERY_SHARE = 0.03
"""Standard deviation of the voltage of a charged battery, as a share of the nominal one."""
_LEARNED = 40
"""Statuses, 20 a second, after which the voltage at the start is known."""


class BatteryTest:
    """Test for a battery that sags: below the voltage at the start, or that of the description."""

    def __init__(self, nominal_v: float) -> None:
        self._nominal_v = nominal_v
        self._cusum = _Cusum(1, _EVIDENCE)
        self._count, self._start = 0, 0.0
        self.share = 1.0
        """Newest voltage over the nominal one."""

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
        """Return the battery, if it sags."""
        if not self._cusum.named[0]:
            return []
        volts, nominal = self.share * self._nominal_v, self._nominal_v
        was = nominal * (1.0 + self._start)
        before = f"{was - volts:.1f} V less than at the start" if was - volts >= 0.05 else ""
        below = f"{nominal - volts:.1f} V below its nominal {nominal:g} V"
        return [Drift("battery", f"The battery has {volts:.1f} V, {before or below}.")]
