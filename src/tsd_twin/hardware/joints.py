"""Joints and actuators: unit conversion and servo calibration file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Protocol

import msgspec
import numpy as np
from msgspec import Meta

from tsd_twin.hardware.dynamixel.control_table import (
    ESCS,
    FULL_THROTTLE,
    RC_CHANNELS,
    RC_US,
    RECEIVER_CHANNELS,
    SERVO_HOT_C,
    SERVOS,
    ZERO_THROTTLE,
)
from tsd_twin.hardware.serial_transport import HardwareError
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import Array
from tsd_twin.messages.codes import Code, Reason, Value, because
from tsd_twin.robots import SingularityDescription
from tsd_twin.safety import Heartbeat

COMMAND_TIMEOUT_S = 0.25
"""Maximum age of a joint command, to drop commands from a hung node."""


@dataclass(frozen=True, slots=True)
class JointCommand:
    """Joint setpoint with its heartbeat and time."""

    setpoint: Array
    """(n,): joint setpoints."""
    heartbeat: Heartbeat
    given_s: float
    """Monotonic time."""

    @classmethod
    def checked(
        cls, setpoint: Array, count: int, heartbeat: Heartbeat, now_s: float
    ) -> JointCommand:
        """Return a command with a copy of a setpoint (`count`,).

        Raises:
            ValueError: If the setpoint has the wrong shape or a value is not finite.
        """
        if np.shape(setpoint) != (count,) or not np.isfinite(setpoint).all():
            raise ValueError(f"set-points must be {count} finite numbers, not {setpoint}")
        return cls(setpoint.copy(), heartbeat, now_s)

    def in_force(self, now_s: float) -> bool:
        """Return whether the command is at most `COMMAND_TIMEOUT_S` old."""
        return now_s - self.given_s <= COMMAND_TIMEOUT_S


CENTRE = 2048


_Pulse = Annotated[int, Meta(ge=RC_US[0], le=RC_US[1])]
_Pulses = tuple[_Pulse, _Pulse, _Pulse, _Pulse]
_Channel = Annotated[int, Meta(ge=1, le=RECEIVER_CHANNELS)]
_STICKS = ("forward", "left", "turn", "speed")
LOW_US, HIGH_US = (1000.0, 1200.0), (1500.0, 2200.0)
"""Pulse widths that the board accepts as zero and full throttle."""
_Low = Annotated[float, Meta(ge=LOW_US[0], le=LOW_US[1])]
_High = Annotated[float, Meta(ge=HIGH_US[0], le=HIGH_US[1])]


class Receiver(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """`[receiver]` of a calibration: type, channels and stick ranges of a radio receiver."""

    kind: Literal["pulses", "sbus"] = "pulses"
    """One wire per channel (six), or a single wire with SBUS frames (16 channels)."""
    channels: tuple[_Channel, _Channel, _Channel, _Channel, _Channel, _Channel] = (1, 2, 3, 4, 5, 6)
    """Channels from 1: forward, left, turn, speed, kill, manual."""
    low_us: _Pulses = (1100, 1100, 1100, 1100)
    """Pulses at the low ends: forward, left, turn, speed."""
    centre_us: _Pulses = (1500, 1500, 1500, 1500)
    high_us: _Pulses = (1900, 1900, 1900, 1900)
    dead_us: Annotated[int, Meta(ge=0, le=100)] = 20
    """Dead band at the centre and at both ends."""

    def __post_init__(self) -> None:
        """Check the channel map and stick ranges.

        Raises:
            ValueError: If two functions share a channel, a channel has no wire, or a stick's centre
                is outside its ends.
        """
        if len(set(self.channels)) < len(self.channels):
            raise ValueError("two functions of the radio control have the same channel")
        if self.kind == "pulses" and max(self.channels) > RC_CHANNELS:
            raise ValueError(f"a receiver with a wire for each channel has {RC_CHANNELS}")
        ends = zip(_STICKS, self.low_us, self.centre_us, self.high_us, strict=True)
        for stick, low_us, centre_us, high_us in ends:
            if low_us >= high_us:
                raise ValueError(f"{stick}: low_us {low_us} is not below high_us {high_us}")
            # The speed stick rests at its low end.
            if stick != "speed" and not low_us <= centre_us <= high_us:
                raise ValueError(
                    f"{stick}: centre_us {centre_us} is outside its ends, {low_us} to {high_us}: "
                    "with the sticks at rest the robot would drive"
                )

    @property
    def map(self) -> int:
        """Channel map for the control table: four bits per function, counted from 0."""
        return sum((channel - 1) << 4 * i for i, channel in enumerate(self.channels))


class EscCalibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """`[speed_controllers]` of a calibration: pulses at zero and full throttle, for each wheel."""

    low_us: tuple[_Low, _Low, _Low] = (1000.0, 1000.0, 1000.0)
    high_us: tuple[_High, _High, _High] = (2000.0, 2000.0, 2000.0)

    def pulses_us(self, throttles: Sequence[int]) -> list[float]:
        """Return the pulses that the board outputs for throttles."""
        span = FULL_THROTTLE - ZERO_THROTTLE
        return [
            low + (throttle - ZERO_THROTTLE) / span * (high - low)
            for low, high, throttle in zip(self.low_us, self.high_us, throttles, strict=True)
        ]


class MotorControllers(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """`[motor_controllers]` of a calibration: controllers of the wheels on CAN."""

    kind: Literal["vesc", "moteus"]
    ids: Sequence[Annotated[int, Meta(ge=1, le=127)]]
    """Id of each wheel's controller."""
    reversed: Sequence[Annotated[int, Meta(ge=1)]] = ()
    """Numbers of the wheels, from 1, whose controller turns in the opposite direction."""
    pole_pairs: Annotated[int, Meta(ge=1, le=50)] = 7
    """Pole pairs of the motor, for VESC."""

    def __post_init__(self) -> None:
        """Check ids and numbers.

        Raises:
            ValueError: If an id is not unique, or a wheel does not exist.
        """
        if len(set(self.ids)) < len(self.ids):
            raise ValueError("two motor controllers have the same id")
        if any(number > len(self.ids) for number in self.reversed):
            raise ValueError(f"reversed: there are wheels 1 to {len(self.ids)}")

    @property
    def signs(self) -> list[int]:
        """Direction of each wheel's controller."""
        return [-1 if i + 1 in self.reversed else 1 for i in range(len(self.ids))]


class ServoCalibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Calibration file (TOML): servo ids, neutral positions and directions, receiver, pulses."""

    neutral_step: dict[str, Annotated[int, Meta(ge=0, le=4095)]] = {}
    """Reported servo position with the gimbal upright; 2048 by default."""
    reversed: Sequence[str] = ()
    """Joints whose servo turns in the opposite direction."""
    servo_id: dict[str, Annotated[int, Meta(ge=1, le=252)]] = {}
    """Servo id on the bus; 1 to 6 in joint order by default."""
    bandgap_mv: Annotated[int, Meta(ge=1000, le=1200)] = 1100
    """Bandgap voltage of the board's chip, the reference for its voltage measurements."""
    receiver: Receiver | None = None
    """Radio receiver; None if the robot has no radio control."""
    speed_controllers: EscCalibration = EscCalibration()
    motor_controllers: MotorControllers | None = None
    """Motor controllers on CAN; None if the wheels have none."""

    @staticmethod
    def read(file: str) -> ServoCalibration:
        """Read a calibration file.

        Raises:
            HardwareError: If the file cannot be read or is not a calibration.
        """
        try:
            return msgspec.toml.decode(Path(file).read_bytes(), type=ServoCalibration)
        except (OSError, msgspec.MsgspecError, UnicodeError) as error:
            raise HardwareError(f"{file} cannot be used as a calibration: {error}") from error

    def check_joints(self, names: Sequence[str]) -> None:
        """Check that all joints in the file exist and that servo ids are unique.

        Raises:
            HardwareError: If a joint is unknown or an id is not unique.
        """
        ids = self.ids(names)
        for name, servo_id in zip(names, ids, strict=True):
            if names[first := ids.index(servo_id)] != name:
                raise HardwareError(
                    f"the servos of {names[first]} and {name} have the same id, {servo_id}"
                )
        for name in (*self.servo_id, *self.neutral_step, *self.reversed):
            if name not in names:
                raise HardwareError(
                    f"the calibration names a joint '{name}': there are {', '.join(names)}"
                )

    def ids(self, names: Sequence[str]) -> list[int]:
        """Return the servo id of each joint."""
        return [self.servo_id.get(name, i) for i, name in enumerate(names, start=1)]

    def neutral(self, names: Sequence[str]) -> list[int]:
        """Return the neutral step of each joint."""
        return [self.neutral_step.get(name, CENTRE) for name in names]

    def signs(self, names: Sequence[str]) -> list[int]:
        """Return the direction of each joint's servo: +1 as drawn, -1 if reversed."""
        return [-1 if name in self.reversed else 1 for name in names]


class ServoNames:
    """Reasons about the servos in a mask, by number from 1 and joint."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = list(names)
        """Joint names in servo order."""
        self.servos = (1 << len(self.names)) - 1
        """Mask of the robot's servos."""

    def named(self, mask: int) -> str:
        """Return the servos in a mask by number and joint, as parameter of a reason."""
        return ", ".join(f"{i + 1} ({name})" for i, name in enumerate(self.names) if mask >> i & 1)

    def about(self, mask: int, code: Code, cause: Reason | None = None, **params: Value) -> Reason:
        """Return a reason that concerns the servos in a mask."""
        return because(code, cause, servos=self.named(mask), **params)

    def silent(self, mask: int) -> Reason:
        """Return the reason for servos that do not respond."""
        if mask == self.servos:
            return because(Code.ALL_SERVOS_SILENT)
        several = mask & mask - 1
        return self.about(mask, Code.SERVO_BUS_SILENT if several else Code.SERVOS_SILENT)


_PULSES_PER_US = 2.0
THROTTLE_RISE_S = 0.25
"""Minimum time that the board takes from zero throttle to the limit."""
_RISE_PERIOD_S = 0.01


class ThrottleLaw(Protocol):
    """Throttle curve of the motors, such as `simulation.actuators.Motors`."""

    def signal(self, speed_rad_per_s: Array) -> Array:
        """Return the throttle signal for each motor's speed."""
        ...

    def pulse_us(self, signal: Array) -> Array:
        """Return the pulse width of a signal, microseconds."""
        ...


class JointConverter(ServoNames):
    """Converts between the joint vector and the units of servos and speed controllers."""

    def __init__(self, robot: SingularityDescription, throttle: ThrottleLaw) -> None:
        """Assign a robot's joints to servos and speed controllers.

        Raises:
            HardwareError: If the board has too few servos or speed controllers, or another
                zero-throttle pulse.
        """
        drive = robot.kinematics()
        angles = np.array([joint.kind is JointKind.POSITION for joint in drive.joints])
        self._angles, self._wheels = np.flatnonzero(angles), np.flatnonzero(~angles)
        if len(self._angles) > SERVOS or len(self._wheels) > ESCS:
            raise HardwareError(
                f"{robot.name} has {len(self._angles)} gimbals and {len(self._wheels)} wheels, "
                f"the board has {SERVOS} servos and {ESCS} speed controllers"
            )
        self._throttle = throttle
        zero_us = float(throttle.pulse_us(throttle.signal(np.zeros(len(self._wheels)))).max())
        if _PULSES_PER_US * zero_us > ZERO_THROTTLE + 1.0:
            raise HardwareError(
                f"{robot.name} has zero throttle at {zero_us:g} us (motor.pulse_low_us), the board "
                f"at {ZERO_THROTTLE / _PULSES_PER_US:g} us, also while it starts: for speed "
                "controllers that run both ways that is full reverse, and they cannot be used; set "
                "them to one direction"
            )
        self._offsets = robot.actuator_offsets()
        self._step_rad = 2.0 * math.pi / robot.servo.steps_per_turn
        self.count = len(drive.joints)
        super().__init__([drive.joints[i].name for i in self._angles])
        self.wheels = [drive.joints[i].name for i in self._wheels]
        """Names of the wheels."""
        most_rad, zero_rad = (
            math.radians(robot.drive.max_tilt_deg),
            self._offsets.offset[self._angles],
        )
        # The limit applies to the gimbal, which may be offset from its servo.
        self._least = np.ceil((-most_rad - zero_rad) / self._step_rad)
        self._most = np.floor((most_rad - zero_rad) / self._step_rad)
        self.goal_limit = int(max(-self._least.min(), self._most.max()))
        """Maximum distance of goals from neutral, steps."""
        fastest = np.zeros(self.count)
        fastest[self._wheels] = robot.wheel_speed_range.most_rad_per_s * drive.spin_ratio
        self.throttle_limit = self.throttles(fastest)
        """Throttle of each wheel at the maximum speed that operators can select."""
        rise = (max(self.throttle_limit) - ZERO_THROTTLE) * _RISE_PERIOD_S / THROTTLE_RISE_S
        self.throttle_rise = max(1, math.ceil(rise))
        """Maximum throttle increase per 10 ms."""

    def goals(self, setpoint: Array) -> tuple[int, ...]:
        """Return the goal of each gimbal, steps from neutral."""
        steps = np.rint(self._offsets.to_actuators(setpoint)[self._angles] / self._step_rad)
        return _ints(np.clip(steps, self._least, self._most))

    def throttles(self, setpoint: Array) -> tuple[int, ...]:
        """Return the pulse of each wheel in half microseconds; speed 0 is zero throttle."""
        actuators = self._offsets.to_actuators(setpoint)[self._wheels]
        pulses = self._throttle.pulse_us(self._throttle.signal(actuators))
        return _ints(np.clip(np.rint(_PULSES_PER_US * pulses), ZERO_THROTTLE, FULL_THROTTLE))

    def measured(
        self, steps: Sequence[int], alive: int, wheels_rad_per_s: Array | None = None
    ) -> Array:
        """Convert steps from neutral and wheel speeds to joints (n,).

        NaN for servos not in the mask `alive`, and for wheels without a measured speed (k,).
        """
        joints = np.full(self.count, np.nan)
        if wheels_rad_per_s is not None:
            joints[self._wheels] = wheels_rad_per_s
        for servo, joint in enumerate(self._angles):
            if alive >> servo & 1:
                joints[joint] = steps[servo] * self._step_rad
        return self._offsets.from_servos(joints)

    def hot(self, mask: int) -> Reason:
        """Return the reason for servos that are too hot."""
        return self.about(mask, Code.SERVO_TOO_HOT, limit_c=SERVO_HOT_C)


def padded_ids(ids: Sequence[int]) -> tuple[int, ...]:
    """Pad `ids` with unused ids for servos that the robot does not have."""
    free = [servo_id for servo_id in range(1, 2 * SERVOS) if servo_id not in ids]
    return (*ids, *free[: SERVOS - len(ids)])


def padded(values: Sequence[int], count: int, filler: int) -> tuple[int, ...]:
    """Pad `values` for actuators that the robot does not have."""
    return (*values, *(filler,) * (count - len(values)))


def _ints(values: Array) -> tuple[int, ...]:
    return tuple(int(value) for value in values)


def hot_servos(temperature_c: Mapping[int, int]) -> int:
    """Return the mask of servos, by index, that are too hot to drive."""
    return sum(1 << i for i, celsius in temperature_c.items() if celsius >= SERVO_HOT_C)
