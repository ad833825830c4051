"""Simulated robots: the robot run by a node, a model of its board, and injected wear."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsd_twin.errors import TwinError
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.robots import RobotDescription
from tsd_twin.simulation.factory import simulate

_MIN_STEP_S = 1e-9
"""Minimum integration step, below which rounding errors dominate the speeds."""


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """Ground truth of a simulated robot."""

    pose: SE2 | SO3
    """Pose of the robot in the world."""
    twist: Array
    """(3,): velocity in the base frame, m/s and rad/s."""
    joints: Array
    """(n,): joint vector, before quantization and noise."""


class SimRobot:
    """Simulated robot in virtual time: actuators, sensors and body.

    The first call sets the time; each later call integrates the motion up to its time. Times in the
    past have no effect.

    `noise` scales the described standard deviations. Wheel speeds are measured if robots of this
    kind do so, unless `measures_spin` overrides it. For `plant`, `errors` and exceptions see
    `simulate`.
    """

    def __init__(
        self,
        robot: RobotDescription,
        seed: int | None = 0,
        noise: float = 0.0,
        *,
        measures_spin: bool | None = None,
        battery_v: float | None = None,
        pose: SE2 | SO3 | None = None,
        plant: str = "kinematic",
        errors: float = 0.0,
    ) -> None:
        self._simulation = simulate(
            robot,
            seed=seed,
            noise=noise,
            battery_v=battery_v,
            pose=pose,
            plant=plant,
            errors=errors,
        )
        joints = self._simulation.kinematics.joints
        measured = robot.measures_spin if measures_spin is None else measures_spin
        self._shape = (len(joints),)
        self._unmeasured = np.flatnonzero(
            [joint.kind is JointKind.VELOCITY and not measured for joint in joints]
        )
        self._facts: dict[str, object] = {
            "kind": "sim",
            "noise": noise,
            "errors": errors,
            "seed": seed,
        }
        self._now_s: float | None = None
        self.delay_s = robot.with_errors(errors).delay_s
        """Bus delay of setpoints and measurements."""

    def read(self, now_s: float) -> Array:
        """Return the measurements (n + s,): joints, then sensors; NaN if not measured."""
        self._advance(now_s)
        measured = self._simulation.measure()
        measured[self._unmeasured] = np.nan
        return measured

    def write(self, setpoint: Array, now_s: float) -> None:
        """Command the setpoints (n,): angles, and wheel speeds, where 0 is zero throttle.

        Raises:
            ValueError: If a number is not finite, or the shape is wrong.
        """
        if np.shape(setpoint) != self._shape:
            raise ValueError(
                f"set-points must have the shape {self._shape}, these have {np.shape(setpoint)}"
            )
        self._advance(now_s)
        self._simulation.command(setpoint)

    def truth(self, now_s: float) -> Truth:
        """Return the true state."""
        self._advance(now_s)
        simulation = self._simulation
        return Truth(simulation.pose, simulation.twist(), simulation.joints.copy())

    def hardware(self) -> dict[str, object]:
        """Return JSON-serializable facts for the status."""
        return self._facts | dict(self._simulation.hardware_status())

    def close(self) -> None:
        """Do nothing, because the simulation holds no resources."""

    def _advance(self, now_s: float) -> None:
        if self._now_s is None:
            self._now_s = now_s
        elif now_s - self._now_s > _MIN_STEP_S:
            self._simulation.advance(now_s - self._now_s)
            self._now_s = now_s


TIMEOUT_S = 0.25
"""Timeout of the command watchdog."""


class BoardModel:
    """Controller board with a command watchdog, in front of a simulated robot.

    `TIMEOUT_S` after the last setpoint, the watchdog trips and stops the actuators, even between
    two calls. A tripped board returns no measurements, which is a fault for the node. It ignores
    setpoints until all wheels are at zero throttle, so the operator must reset and arm. At zero
    throttle on all wheels the watchdog does not trip.
    """

    def __init__(self, robot: RobotDescription, simulated: SimRobot) -> None:
        kinematics = robot.kinematics()
        self._simulated = simulated
        self._wheels = np.flatnonzero([j.kind is JointKind.VELOCITY for j in kinematics.joints])
        self._rest = kinematics.inverse(np.zeros(len(kinematics.twist_axes)))
        self._rest[self._wheels] = 0.0
        self._obeyed: Array = self._rest
        self._fed_s = 0.0
        self.tripped = False

    def read(self, now_s: float) -> Array | None:
        """Return the measured joints (n,), or None if the watchdog has tripped."""
        self._check_watchdog(now_s)
        measured = self._simulated.read(now_s)
        return None if self.tripped else measured

    def write(self, setpoint: Array, now_s: float) -> None:
        """Forward a setpoint (n,), unless the watchdog has tripped.

        Raises:
            ValueError: If a number is not finite, or the shape is wrong.
        """
        self._check_watchdog(now_s)
        if self.tripped and not setpoint[self._wheels].any():
            self.tripped = False
        if not self.tripped:
            self._simulated.write(setpoint, now_s)
            self._obeyed, self._fed_s = setpoint.copy(), now_s

    def truth(self, now_s: float) -> Truth:
        """Return the true state."""
        self._check_watchdog(now_s)
        return self._simulated.truth(now_s)

    def hardware(self) -> Mapping[str, object]:
        """Return JSON-serializable facts for the status."""
        return {**self._simulated.hardware(), "tripped": self.tripped}

    def close(self) -> None:
        """Close the simulated robot."""
        self._simulated.close()

    def _check_watchdog(self, now_s: float) -> None:
        spins = bool(self._obeyed[self._wheels].any())
        if spins and not self.tripped and now_s - self._fed_s > TIMEOUT_S:
            self.tripped = True
            self._obeyed = self._rest
            self._simulated.write(self._rest, self._fed_s + TIMEOUT_S)


USUAL_LEAN_DEG = 2.0


@dataclass(frozen=True, slots=True)
class StuckJoint:
    """Injected fault: a servo that blocks once its gimbal reaches an angle."""

    joint: str
    lean_rad: float = 0.0

    @staticmethod
    def parse(text: str, robot: RobotDescription) -> StuckJoint:
        """Parse a fault such as `module2_alpha` or `module2_alpha@3`, where 3 is in degrees.

        Raises:
            TwinError: If the text is malformed, or the robot has no such gimbal.
        """
        joint, _, lean = text.partition("@")
        gimbals = [j.name for j in robot.kinematics().joints if j.kind is JointKind.POSITION]
        if joint not in gimbals:
            there = f"there are {', '.join(gimbals)}" if gimbals else "it has none"
            raise TwinError(f"--jam: '{joint}' is no gimbal of {robot.name}: {there}")
        try:
            lean_deg = float(lean) if lean else USUAL_LEAN_DEG
        except ValueError:
            lean_deg = math.nan
        if not 0.0 <= lean_deg < 90.0:
            raise TwinError(f"--jam: '{lean}' has to be degrees, from 0 to less than 90")
        return StuckJoint(joint, math.radians(lean_deg))


class RobotWithStuckJoint(SimRobot):
    """Simulated robot with blocked gimbal servos."""

    def __init__(
        self, robot: RobotDescription, jams: Sequence[StuckJoint] = (), **kwargs: Any
    ) -> None:
        """Accept the arguments of `SimRobot` in addition to `jams`."""
        super().__init__(robot, **kwargs)
        self._names = [joint.name for joint in robot.kinematics().joints]
        self._block_angles: dict[int, float] = {}
        self._held: dict[int, float] = {}
        for jam in jams:
            self.jam(jam)

    def jam(self, jam: StuckJoint) -> None:
        """Block a gimbal servo."""
        self._block_angles[self._names.index(jam.joint)] = jam.lean_rad

    def write(self, setpoint: Array, now_s: float) -> None:
        """Write setpoints (n,); a blocked joint keeps its current angle."""
        if not self._block_angles:
            super().write(setpoint, now_s)
            return
        joints = self.truth(now_s).joints
        for place, lean_rad in self._block_angles.items():
            if abs(joints[place]) >= lean_rad:
                self._held.setdefault(place, float(joints[place]))
        if self._held and np.shape(setpoint) == np.shape(joints):
            setpoint = setpoint.copy()
            setpoint[list(self._held)] = list(self._held.values())
        super().write(setpoint, now_s)


_NUMBER = r"\d+(?:\.\d+)?"
_FORM = re.compile(rf"(?P<part>\w+)=-(?P<size>{_NUMBER})(?P<unit>%|V)(?:@(?P<after>{_NUMBER}))?")
BATTERY = "battery"
_DRIVING = 0.02
"""True speed (m/s or rad/s) above which the robot counts as driving."""


@dataclass(frozen=True, slots=True)
class Wear:
    """Wear after some driving time: a slower joint, or a lower battery voltage."""

    part: str
    """Name of a joint, or `battery`."""
    lost: float
    """Fractional speed loss of the joint, or volts."""
    after_s: float = 0.0
    """Driving time before the wear begins."""

    @staticmethod
    def parse(text: str, robot: RobotDescription) -> Wear:
        """Parse wear such as `module2_alpha=-30%@10` or `battery=-1V`, where 10 is in seconds.

        Raises:
            TwinError: If the text is malformed, or the robot has no such joint.
        """
        found, size, after_s = _FORM.fullmatch(text), 0.0, 0.0
        if found is not None:
            size, after_s = float(found["size"]), float(found["after"] or 0.0)
        joints = [joint.name for joint in robot.kinematics().joints]
        if found is None or (found["part"] == BATTERY) != (found["unit"] == "V"):
            raise TwinError(f"--wear: '{text}' is not like {joints[0]}=-30%@10 or {BATTERY}=-1V")
        if found["part"] not in [*joints, BATTERY]:
            raise TwinError(
                f"--wear: '{found['part']}' is no joint of {robot.name}: "
                f"there are {', '.join(joints)} and {BATTERY}"
            )
        most, unit = (robot.battery.nominal_v, " V") if found["unit"] == "V" else (100.0, " %")
        if not 0.0 < size < most:
            raise TwinError(f"--wear: '{text}' has to be more than 0 and less than {most:g}{unit}")
        return Wear(found["part"], size if found["unit"] == "V" else size / 100.0, after_s)


class WornRobot(RobotWithStuckJoint):
    """Simulated robot whose parts wear while it drives."""

    def __init__(self, robot: RobotDescription, wear: Sequence[Wear] = (), **kwargs: Any) -> None:
        """Accept the arguments of `RobotWithStuckJoint` in addition to `wear`."""
        super().__init__(robot, **kwargs)
        self._upcoming = list(wear)
        self._joint_shares = np.ones(len(self._names))
        self._driven_s = 0.0
        self._read_s: float | None = None

    def wear(self, wear: Wear) -> None:
        """Apply wear to a part."""
        if wear.part == BATTERY:
            volts = self._simulation.hardware_status()["battery_v"]
            assert isinstance(volts, float)  # noqa: S101  Each simulation has a battery.
            self._simulation.set_battery(volts - wear.lost)
        else:
            self._joint_shares[self._names.index(wear.part)] = 1.0 - wear.lost
            self._simulation.degrade(self._joint_shares)

    def read(self, now_s: float) -> Array:
        """Apply wear that is due, and return the measurements."""
        measured = super().read(now_s)
        if self._upcoming:
            if self._read_s is not None and np.abs(self._simulation.twist()).max() > _DRIVING:
                self._driven_s += now_s - self._read_s
            self._read_s = now_s
            due = [each for each in self._upcoming if each.after_s <= self._driven_s]
            self._upcoming = [each for each in self._upcoming if each not in due]
            for each in due:
                self.wear(each)
        return measured
