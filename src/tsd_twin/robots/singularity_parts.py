"""Parts of a singularity drive in its description: geometry, servos, motors and their errors."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self, TypeAlias

import msgspec
import numpy as np
from msgspec import UNSET, Meta, UnsetType

from tsd_twin.lie import Array
from tsd_twin.tables import NotNegative, Positive, Table


class ModulePosition(Table, frozen=True):
    """One of `[[drive.modules]]`: the pivot of a module in the robot frame."""

    x_m: float
    y_m: float


class SingularityGeometry(Table, frozen=True, kw_only=True, tag="singularity", tag_field="kind"):
    """`[drive]` of a singularity drive.

    Pivots lie on a circle (`azimuths_deg` with `pivot_radius_m`) or at any positions (`modules`).
    The outer axis of a module points from the centre of the robot to its pivot, or along X for a
    module in the centre.
    """

    azimuths_deg: Annotated[list[float], Meta(min_length=2, max_length=12)] | UnsetType = UNSET
    """Direction of each pivot, from X forward towards Y left."""
    pivot_radius_m: Positive | UnsetType = UNSET
    module_positions: (
        Annotated[list[ModulePosition], Meta(min_length=2, max_length=12)] | UnsetType
    ) = msgspec.field(default=UNSET, name="modules")
    """Position of each pivot, instead of the two keys above."""
    wheel_radius_m: Positive
    max_tilt_deg: Annotated[float, Meta(gt=0.0, lt=80.0)]
    cruise_speed_rpm: Positive
    """Wheel speed while the robot is ready."""
    max_speed_rpm: Positive | None = None
    """Maximum selectable wheel speed; by default the maximum that all motors reach."""
    spin_ratio: list[Positive] = msgspec.field(default_factory=list[Positive])
    """Speed of each wheel relative to the selected speed; default 1."""

    def __post_init__(self) -> None:
        """Check that the pivots are given in one of the two forms.

        Raises:
            ValueError: If they are not.
        """
        circle = (self.azimuths_deg, self.pivot_radius_m)
        given = [not isinstance(value, UnsetType) for value in (*circle, self.module_positions)]
        if given not in ([True, True, False], [False, False, True]):
            raise ValueError(
                "the pivots need azimuths_deg and pivot_radius_m, or modules with x_m and y_m"
            )

    @property
    def positions(self) -> list[ModulePosition]:
        """Entries of `[[drive.modules]]`; empty if the pivots are given on a circle."""
        return [] if isinstance(self.module_positions, UnsetType) else self.module_positions

    @property
    def modules(self) -> int:
        """Number of wheels."""
        return len(self.directions_deg)

    @property
    def modules_key(self) -> str:
        """Key of the list with one entry per module, for error messages."""
        return "drive.modules" if self.positions else "drive.azimuths_deg"

    @property
    def radius_key(self) -> str:
        """Key that sets the distance of the pivots, for error messages."""
        return "drive.modules" if self.positions else "drive.pivot_radius_m"

    @property
    def directions_deg(self) -> list[float]:
        """Azimuth of each module, from X forward towards Y left."""
        if self.positions:
            # Adding 0.0 removes the sign of -0.0, which would turn the module.
            return [math.degrees(math.atan2(p.y_m + 0.0, p.x_m + 0.0)) for p in self.positions]
        return [] if isinstance(self.azimuths_deg, UnsetType) else self.azimuths_deg

    @property
    def pivot_radii_m(self) -> float | Array:
        """Distance of the pivots from the centre: one for all, or (k,)."""
        if self.positions:
            return np.array([math.hypot(p.x_m, p.y_m) for p in self.positions])
        return 0.0 if isinstance(self.pivot_radius_m, UnsetType) else self.pivot_radius_m

    @property
    def pivots_m(self) -> Array:
        """(k, 2): positions of the pivots in the robot frame."""
        if self.positions:
            return np.array([[p.x_m, p.y_m] for p in self.positions])
        azimuths = np.radians(self.directions_deg)
        return self.pivot_radii_m * np.stack([np.cos(azimuths), np.sin(azimuths)], axis=-1)

    @property
    def rms_radius_m(self) -> float:
        """Root mean square of the pivot distances: the radius of a circle that turns equally."""
        radii_m = self.pivot_radii_m
        if isinstance(radii_m, float):
            return radii_m
        return math.sqrt(float(np.mean(np.square(radii_m))))

    def with_rms_radius(self, radius_m: float) -> Self:
        """Return the geometry with all pivots moved outward or inward by one factor."""
        if self.positions:
            factor = radius_m / self.rms_radius_m
            moved = [ModulePosition(factor * p.x_m, factor * p.y_m) for p in self.positions]
            return msgspec.structs.replace(self, module_positions=moved)
        return msgspec.structs.replace(self, pivot_radius_m=float(radius_m))


class Servo(Table, frozen=True):
    """`[servo]`: one gimbal actuator."""

    model: str
    steps_per_turn: Annotated[int, Meta(gt=0)]
    no_load_speed_rpm: Positive
    """Speed limit at nominal battery voltage."""
    approach_rate_per_s: Positive
    """Rate of the exponential decay of the error close to the goal."""
    stall_torque_nm: Positive = 6.0
    """Stall torque at nominal battery voltage, for the gimbal stiffness; defaults to an MX-64."""
    size_m: tuple[Positive, Positive, Positive] = (0.0402, 0.0611, 0.041)
    """Width, length and depth along the shaft of the case; defaults to an MX-64."""
    joint_rounding: bool = False
    """Whether the controller rounds the goals of all servos together, nearest to the twist."""


class Motor(Table, frozen=True):
    """`[motor]`: drive motors with speed controllers, one curve per wheel."""

    signal: Annotated[list[float], Meta(min_length=2)]
    """Throttle signal of each row of the calibration table, increasing."""
    speed_rpm: Annotated[list[list[NotNegative]], Meta(min_length=1)]
    """Measured speed at each signal, one list per motor."""
    start_speed_rpm: NotNegative
    """Dead band: below this speed the motor does not turn."""
    time_constant_up_s: Positive
    time_constant_down_s: Positive
    pulse_low_us: Positive = 1000.0
    """Pulse width of the lowest signal."""
    pulse_high_us: Positive = 2000.0
    arming_hold_s: NotNegative = 2.0
    """Time at zero throttle that the speed controllers need before they arm."""


MAX_PULSES_PER_S = 1000.0
"""Maximum pulse rate of a wheel sensor at the controller board."""


class WheelSensor(Table, frozen=True):
    """`[wheel_sensor]`: speed sensors of the wheels, at the controller board.

    Each sends pulses on one wire: a Hall sensor at the wheel or motor, or one phase of the motor.
    With `telemetry`, each speed controller (KISS, BLHeli_32) sends the speed to an RP2040 board.
    """

    kind: Literal["hall", "telemetry"] = "hall"
    pulses_per_turn: Annotated[int, Meta(ge=1, le=255)] | UnsetType = UNSET
    """Pulses per turn of the wheel: magnets, or pole pairs of the motor. For `hall` only."""
    pole_pairs: Annotated[int, Meta(ge=1, le=255)] | UnsetType = UNSET
    """Pole pairs of the motor, whose electrical speed is sent. For `telemetry` only."""

    def __post_init__(self) -> None:
        """Check that the number belongs to the kind.

        Raises:
            ValueError: If it does not.
        """
        given = not isinstance(self.pulses_per_turn, UnsetType)
        pairs = not isinstance(self.pole_pairs, UnsetType)
        if (given, pairs) != (self.kind == "hall", self.kind == "telemetry"):
            raise ValueError("kind 'hall' needs pulses_per_turn, kind 'telemetry' pole_pairs")

    @property
    def per_turn(self) -> int:
        """Pulses per turn, or pole pairs."""
        number = self.pole_pairs if self.kind == "telemetry" else self.pulses_per_turn
        return 1 if isinstance(number, UnsetType) else number


class Mass(Table, frozen=True):
    """`[mass]`: for the covariance on a floor, gimbal deflection, the dynamics and the URDF."""

    total_kg: Positive
    wheel_kg: Positive
    gimbal_kg: Positive
    """Mass of an outer or inner frame with its load."""


class Noise(Table, frozen=True):
    """`[noise]`: standard deviations, for the covariance and as the simulator's default."""

    gimbal_angle_deg: NotNegative = 0.0
    speed_scale_sigma: NotNegative = 0.0
    """Standard deviation of a wheel speed."""


SpinScale: TypeAlias = Annotated[float, Meta(ge=0.5, le=2.0)]
"""Plausibility limit; a larger error means a wrong motor or battery."""


class Calibration(Table, frozen=True):
    """`[calibration]`: results of `tsd-lab calibrate`, `turn` and `zero` for one robot."""

    tilt_offset_deg: list[tuple[float, float]] = msgspec.field(
        default_factory=list[tuple[float, float]]
    )
    """Gimbal angles (alpha, beta) of each module at servo angle zero."""
    spin_scale: list[SpinScale] = msgspec.field(default_factory=list[SpinScale])
    """Speed of each wheel relative to the curve of `[motor]`."""
