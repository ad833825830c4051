"""Simulated calibration runs: a robot with random model errors, driven through squares and
turns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import msgspec
import numpy as np

from tsd_twin.calibration.recording import Recording
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityDescription
from tsd_twin.simulation import Camera, CameraNoise, Frame, SimRobot
from tsd_twin.virtual_robot import PERIOD_S, VirtualRobot, voltage_share

OFFSET_SIGMA_DEG = 0.3
"""Standard deviation of a random gimbal zero, as set with a spirit level (assumed)."""
RADIUS_SIGMA_SHARE, SPIN_SIGMA_SHARE = 0.01, 0.01
"""Standard deviations of both radii, as measured with a ruler, and of a motor curve (assumed)."""


class PerturbedRobot(SimRobot):
    """Simulator of the robot `true` for a controller that is configured with `believed`.

    The interface carries servo angles and throttles; each side converts them to joints with its own
    calibration.
    """

    def __init__(
        self,
        believed: SingularityDescription,
        true: SingularityDescription,
        seed: int,
        noise: float,
        errors: float = 0.0,
    ) -> None:
        super().__init__(true, seed=seed, noise=noise, errors=errors)
        self._believed, self._true = believed.actuator_offsets(), true.actuator_offsets()

    def read(self, now_s: float) -> Array:
        """Measurement (n,), in joints of the description `believed`."""
        return self._believed.from_servos(self._true.to_servos(super().read(now_s)))

    def write(self, setpoint: Array, now_s: float) -> None:
        """Apply set-points (n,), in joints of the description `believed`."""
        super().write(self._true.from_actuators(self._believed.to_actuators(setpoint)), now_s)


def random_robot(
    believed: SingularityDescription, random: np.random.Generator
) -> SingularityDescription:
    """Random robot as it may be built from a description, with parameter errors.

    The errors of zeros and spins in `[errors]` and `[noise]` are set to zero: they are drawn into
    `[calibration]` instead, where they can be compared with the fit.
    """
    modules = believed.drive.modules
    trim = believed.actuator_offsets()
    offset = np.degrees(trim.offset).reshape(modules, 3)[:, :2]
    offset = offset + OFFSET_SIGMA_DEG * random.standard_normal((modules, 2))
    scale = trim.scale.reshape(modules, 3)[:, 2] * (
        1.0 + SPIN_SIGMA_SHARE * random.standard_normal(modules)
    )
    radii = 1.0 + RADIUS_SIGMA_SHARE * random.standard_normal(2)
    return with_calibration(
        msgspec.structs.replace(
            believed,
            noise=msgspec.structs.replace(believed.noise, spin_share=0.0),
            errors=msgspec.structs.replace(believed.errors, zero_deg=0.0),
        ),
        offset,
        scale,
        believed.drive.wheel_radius_m * radii[0],
        believed.drive.pivot_radius_m * radii[1],
    )


def with_calibration(
    robot: SingularityDescription,
    offset_deg: Array,
    scale: Array,
    wheel_radius_m: float,
    pivot_radius_m: float,
) -> SingularityDescription:
    """Robot with other radii, zeros `offset_deg` (k, 2) and spins `scale` (k,)."""
    pairs = [(float(alpha), float(beta)) for alpha, beta in offset_deg]
    return msgspec.structs.replace(
        robot,
        drive=msgspec.structs.replace(
            robot.drive, wheel_radius_m=float(wheel_radius_m), pivot_radius_m=float(pivot_radius_m)
        ),
        calibration=msgspec.structs.replace(
            robot.calibration, tilt_offset_deg=pairs, spin_scale=[float(each) for each in scale]
        ),
    )


FAST_WHEEL_RATIO = 1.6
"""Speed of one wheel relative to the others, in each run except the first."""
SPEED_MPS, SIDE_M, TURN_RAD_PER_S = 1.0, 1.0, 2.0
TACHOMETER_SHARE = 0.002
"""Noise of one reading of a wheel's speed (assumed)."""
_REST_S = 0.5
"""Time longer than the delay of the camera."""


def spin_ratios(modules: int) -> list[list[float]]:
    """Wheel speeds of each run relative to cruise speed: all alike, then one faster.

    At equal speeds only three combinations of the gimbal zeros are observable; the others only
    press the wheels against each other. A faster wheel weights its own zeros more, which makes all
    of them observable.
    """
    return [
        [FAST_WHEEL_RATIO if i == j - 1 else 1.0 for i in range(modules)]
        for j in range(modules + 1)
    ]


def excitation_twists() -> Array:
    """Twists (n, 3) of a run for each period: squares and turns, both ways."""
    sides = SPEED_MPS * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    legs: list[tuple[Array, float]] = [(np.zeros(3), _REST_S)]
    for way, corners in ((1.0, sides), (-1.0, sides[::-1])):
        legs += [(np.append(side, 0.0), SIDE_M / SPEED_MPS) for side in corners]
        turn = np.array([0.0, 0.0, way * TURN_RAD_PER_S])
        legs.append((turn, 2.0 * math.pi / TURN_RAD_PER_S))
    legs.append((np.zeros(3), _REST_S))
    return np.concatenate([np.tile(leg, (round(s / PERIOD_S), 1)) for leg, s in legs])


def simulate_run(
    believed: SingularityDescription,
    machine: PerturbedRobot,
    ratio: list[float],
    seed: int,
    start_s: float = 0.0,
    *,
    tachometer: bool,
    periods: Callable[[Array], Iterable[Array]] = iter,
) -> Recording:
    """Simulate one open-loop run, wheels at `ratio` (k,) of cruise speed; return the recording.

    The robot has been at rest since `start_s`.
    """
    random = np.random.default_rng(seed)
    robot = VirtualRobot(_with_spin_ratio(believed, ratio), machine, start_s)
    at_voltage = voltage_share(robot)
    camera = Camera(CameraNoise(), random)
    measured: list[Array] = []
    commanded: list[Array] = []
    speeds: list[Array] = []
    frames: list[Frame] = []
    start_s, t_s = robot.now_s, np.empty(0)
    for twist in periods(excitation_twists()):
        now_s = robot.now_s - start_s
        t_s = np.append(t_s, now_s)
        measured.append(robot.controller.joints.reshape(-1, 3)[:, :2].ravel())
        commanded.append(at_voltage * robot.controller.setpoint[2::3])
        speeds.append(machine.truth(robot.now_s).joints[2::3])
        frames += camera.capture(now_s, robot.truth)
        robot.drive(twist)
    spin = np.array(speeds) * (1.0 + TACHOMETER_SHARE * random.standard_normal(np.shape(speeds)))
    return Recording(
        t_s,
        np.array(measured),
        np.array(commanded),
        spin if tachometer else np.full(spin.shape, np.nan),
        np.array([frame.taken_s for frame in frames]),
        np.array([frame.pose for frame in frames]),
    )


def _with_spin_ratio(robot: SingularityDescription, ratio: list[float]) -> SingularityDescription:
    return msgspec.structs.replace(
        robot, drive=msgspec.structs.replace(robot.drive, spin_ratio=ratio)
    )
