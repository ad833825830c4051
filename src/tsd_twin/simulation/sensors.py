"""Simulation interface and wrappers, and simulated sensors with delay, noise and bias."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import SE2, Array
from tsd_twin.robots import Gyro
from tsd_twin.robots.omni import DeadWheels
from tsd_twin.simulation.singularity import Actuation


class Simulation(Protocol):
    """Identical robots in virtual time: one, or a batch in lockstep.

    Actuators drive a plant. Measurements are separate from ground truth.
    """

    @property
    def kinematics(self) -> Kinematics[Any]:
        """Kinematics used to drive the robot."""
        ...

    @property
    def pose(self) -> Any:
        """True pose in the world (the kinematics' pose type)."""
        ...

    @property
    def joints(self) -> Array:
        """(..., n): true joint vector."""
        ...

    def command(self, setpoint: Array) -> None:
        """Set the setpoints of all actuators, (..., n) in the order of `kinematics.joints`.

        Raises:
            ValueError: If a number is not finite, or the shape is wrong.
        """
        ...

    def degrade(self, shares: Array) -> None:
        """Slow down joints: `shares` (..., n) are speeds relative to healthy joints."""
        ...

    def set_battery(self, battery_v: float) -> None:
        """Set the voltage of the battery."""
        ...

    def advance(self, dt_s: float) -> None:
        """Advance by `dt_s` seconds."""
        ...

    def measure(self) -> Array:
        """Return the measurements (..., n + s): joints, then the robot's sensors."""
        ...

    def twist(self) -> Array:
        """Return the true twist (..., 3) in the base frame."""
        ...

    def hardware_status(self) -> Mapping[str, object]:
        """Return the hardware section of a single robot's status, JSON-serializable."""
        ...


S = TypeVar("S", bound=Simulation)


class SimulationWrapper(Generic[S]):
    """Base class of simulation wrappers: forwards all but `measure`, which subclasses define."""

    def __init__(self, simulation: S) -> None:
        self.simulation = simulation
        """Wrapped simulation."""

    @property
    def kinematics(self) -> Kinematics[Any]:
        """Kinematics used to drive the robot."""
        return self.simulation.kinematics

    @property
    def pose(self) -> Any:
        """True pose in the world."""
        return self.simulation.pose

    @property
    def joints(self) -> Array:
        """(..., n): true joint vector."""
        return self.simulation.joints

    def command(self, setpoint: Array) -> None:
        """Set the setpoints of the wrapped simulation."""
        self.simulation.command(setpoint)

    def degrade(self, shares: Array) -> None:
        """Slow down joints of the wrapped simulation."""
        self.simulation.degrade(shares)

    def set_battery(self, battery_v: float) -> None:
        """Set the voltage of the battery."""
        self.simulation.set_battery(battery_v)

    def advance(self, dt_s: float) -> None:
        """Advance by `dt_s` seconds."""
        self.simulation.advance(dt_s)

    def twist(self) -> Array:
        """Return the true twist (..., 3) in the base frame."""
        return self.simulation.twist()

    def hardware_status(self) -> Mapping[str, object]:
        """Return the hardware status of the wrapped simulation."""
        return self.simulation.hardware_status()


class Actuated(Simulation, Protocol):
    """Simulation whose measurements depend only on its joints."""

    actuation: Actuation


class DelayWrapper(SimulationWrapper[Actuated]):
    """Simulation wrapper that delays setpoints and joint measurements by `delay_s`.

    Ground truth is not delayed. Joints are interpolated linearly between two calls of `advance`.
    """

    def __init__(self, simulation: Actuated, delay_s: float) -> None:
        super().__init__(simulation)
        self._delay_s = delay_s
        self._now_s = 0.0
        self._in_transit: deque[tuple[float, Array]] = deque()
        self._history: deque[tuple[float, Array]] = deque([(0.0, simulation.joints.copy())])

    def command(self, setpoint: Array) -> None:
        """Queue setpoints, as in `Actuation.command`."""
        checked = self.simulation.actuation.checked(setpoint)
        self._in_transit.append((self._now_s + self._delay_s, checked.copy()))

    def advance(self, dt_s: float) -> None:
        """Advance by `dt_s` seconds; setpoints take effect after their delay."""
        end_s = self._now_s + dt_s
        while self._in_transit and self._in_transit[0][0] <= end_s:
            due_s, setpoint = self._in_transit.popleft()
            self._pass(due_s)
            self.simulation.command(setpoint)
        self._pass(end_s)

    def measure(self) -> Array:
        """Return the measurements (..., n) from `delay_s` ago."""
        delayed_s = self._now_s - self._delay_s
        (before_s, before), *rest = self._history
        if not rest or delayed_s <= before_s:
            return self.simulation.actuation.measure(before)
        after_s, after = rest[0]
        share = (delayed_s - before_s) / (after_s - before_s)
        return self.simulation.actuation.measure(before + share * (after - before))

    def _pass(self, now_s: float) -> None:
        if now_s > self._now_s:
            self.simulation.advance(now_s - self._now_s)
            self._now_s = now_s
            self._history.append((now_s, np.array(self.simulation.joints)))
        while len(self._history) > 1 and self._history[1][0] <= self._now_s - self._delay_s:
            self._history.popleft()


@dataclass(frozen=True, slots=True)
class CameraNoise:
    """Noise, delay and frame rate of an overhead camera (24 fps in the thesis, rest assumed)."""

    rate_hz: float = 24.0
    late_s: float = 0.08
    sigma_m: float = 0.005
    sigma_rad: float = 0.02
    mounting_m: float = 0.0
    """Standard deviation of a constant error of x and y."""
    mounting_rad: float = 0.0
    """Standard deviation of a constant error of the heading."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """Camera frame: a measured pose with its time."""

    taken_s: float
    pose: Array
    """(3,): x, y, heading."""


class Camera:
    """Simulated overhead camera: noisy poses at a frame rate, with processing delay."""

    def __init__(self, noise: CameraNoise, random: np.random.Generator) -> None:
        self.noise = noise
        self._random = random
        self._mounting = np.zeros(3)
        if noise.mounting_m > 0.0 or noise.mounting_rad > 0.0:
            mounting = np.array([noise.mounting_m, noise.mounting_m, noise.mounting_rad])
            self._mounting = mounting * random.standard_normal(3)
        self._next_s = 0.0
        self._in_transit: deque[Frame] = deque()

    def capture(self, now_s: float, pose: SE2) -> list[Frame]:
        """Measure a robot at `pose` (3,), and return the frames whose processing has finished."""
        if now_s >= self._next_s - 1e-9:
            # Frames missed between two calls are dropped.
            self._next_s = max(self._next_s + 1.0 / self.noise.rate_hz, now_s)
            sigma = np.array([self.noise.sigma_m, self.noise.sigma_m, self.noise.sigma_rad])
            seen = pose.xy_heading + self._mounting + sigma * self._random.standard_normal(3)
            self._in_transit.append(Frame(now_s, seen))
        known: list[Frame] = []
        while self._in_transit and self._in_transit[0].taken_s + self.noise.late_s <= now_s + 1e-9:
            known.append(self._in_transit.popleft())
        return known


class DeadWheelSensors:
    """Two passive tracking wheels without slip, and a gyro; arrays have a leading batch."""

    def __init__(
        self, sensors: DeadWheels, batch: tuple[int, ...], random: np.random.Generator, noise: float
    ) -> None:
        self._step_rad = 2.0 * math.pi / sensors.pulses_per_turn
        self._range = math.radians(sensors.gyro_range_deg_per_s)
        drift = noise * math.radians(sensors.gyro_drift_deg_per_h) / 3600.0
        self._drift = drift * random.standard_normal(batch)
        rows = np.array(sensors.rows())
        across = np.array(sensors.rows(0.5 * math.pi))
        turned = noise * math.radians(sensors.mounting_deg) * random.standard_normal((*batch, 2, 1))
        radius = 1.0 + noise * sensors.radius_share * random.standard_normal((*batch, 2, 1))
        self._rows = (np.cos(turned) * rows + np.sin(turned) * across) / (sensors.radius_m * radius)
        # Wheels start anywhere between two pulses.
        between = random.uniform(0.0, self._step_rad, (*batch, 2))
        self._angles = between if noise > 0.0 else np.zeros((*batch, 2))

    def advance(self, twist: Array, dt_s: float) -> None:
        """Integrate the wheel angles for `dt_s` at a mean `twist` (..., 3)."""
        self._angles = self._angles + dt_s * (self._rows @ twist[..., None])[..., 0]

    def measure(self, twist: Array) -> Array:
        """Return both angles in whole pulses, radians, and the rate, rad/s, (..., 3)."""
        pulses = np.floor(self._angles / self._step_rad) * self._step_rad
        rate = np.clip(twist[..., 2] + self._drift, -self._range, self._range)
        return np.concatenate([pulses, rate[..., None]], axis=-1)


class YawGyro:
    """Simulated yaw gyro: white noise and a bias that is constant per run.

    `scale` multiplies the described errors; each robot of a batch has a separate gyro.
    """

    def __init__(
        self,
        noise: Gyro,
        random: np.random.Generator,
        batch: tuple[int, ...] = (),
        *,
        scale: float = 1.0,
    ) -> None:
        self.noise = noise
        self._random = random
        self._batch = batch
        self._bias = scale * noise.bias_rad_per_s * random.standard_normal(batch)
        self._sigma = scale * noise.noise_rad_per_s

    def measure(self, rate: Array) -> Array:
        """Return readings (...), rad/s, for true turn rates `rate` (...)."""
        return rate + self._bias + self._sigma * self._random.standard_normal(self._batch)


class GyroSimulation(SimulationWrapper[Simulation]):
    """Simulation wrapper that appends a gyro's turn rate to the measurements.

    `noise` scales the described standard deviations. The gyro is not on the actuator bus, so it has
    no delay.
    """

    def __init__(
        self,
        simulation: Simulation,
        gyro: Gyro,
        batch: tuple[int, ...] = (),
        *,
        seed: int | None = 0,
        noise: float = 0.0,
    ) -> None:
        super().__init__(simulation)
        # A separate random generator keeps a robot's errors the same with and without a gyro.
        random = np.random.default_rng(None if seed is None else [seed, 2])
        self._gyro = YawGyro(gyro, random, batch, scale=noise)

    def measure(self) -> Array:
        """Return the wrapped simulation's measurements and the turn rate, rad/s, (..., n + 1)."""
        rate = self._gyro.measure(self.twist()[..., 2])
        return np.concatenate([self.simulation.measure(), rate[..., None]], axis=-1)
