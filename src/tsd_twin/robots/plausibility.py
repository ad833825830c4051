"""Plausible ranges of the numbers in a description, for robots of 5 cm to 20 m.

A number outside its range is almost always in the wrong unit: millimetres, degrees, grams. The
ranges are wide enough for any robot that can be built.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby

from tsd_twin.tables import Problem

RANGES: dict[str, tuple[float, float]] = {
    "limits.speed_mps": (0.001, 50.0),
    "limits.turn_rate_rad_per_s": (0.001, 100.0),
    "limits.acceleration_mps2": (0.001, 200.0),
    "limits.deceleration_mps2": (0.001, 200.0),
    "limits.angular_acceleration_rad_per_s2": (0.001, 2000.0),
    "limits.command_timeout_s": (0.01, 60.0),
    "limits.max_command_age_s": (0.01, 60.0),
    "limits.max_command_age_ceiling_s": (0.01, 60.0),
    "limits.stop_allowance_m": (0.001, 100.0),
    "battery.nominal_v": (1.0, 1000.0),
    "battery.warn_v": (0.0, 1000.0),
    "battery.low_speed_share": (0.01, 1.0),
    "battery.arm_v": (0.0, 1000.0),
    "battery.stop_v": (0.0, 1000.0),
    "body.plate_thickness_m": (0.0001, 0.5),
    "body.ground_clearance_m": (0.0001, 5.0),
    "pose_sensor.sigma_m": (1e-6, 10.0),
    "pose_sensor.sigma_deg": (1e-4, 90.0),
    "pose_sensor.mounting_m": (0.0, 10.0),
    "pose_sensor.mounting_deg": (0.0, 90.0),
    "drive.azimuths_deg": (-720.0, 720.0),
    "drive.pivot_radius_m": (0.002, 20.0),
    "drive.modules.x_m": (-20.0, 20.0),
    "drive.modules.y_m": (-20.0, 20.0),
    "drive.wheel_radius_m": (0.0005, 5.0),
    "drive.max_tilt_deg": (1.0, 80.0),
    "drive.cruise_speed_rpm": (1.0, 300_000.0),
    "drive.max_speed_rpm": (1.0, 300_000.0),
    "drive.spin_ratio": (0.01, 100.0),
    "drive.wheels.x_m": (-20.0, 20.0),
    "drive.wheels.y_m": (-20.0, 20.0),
    "drive.wheels.direction_deg": (-720.0, 720.0),
    "drive.wheels.roller_deg": (-90.0, 90.0),
    "drive.friction": (0.001, 20.0),
    "drive.slip": (0.0, 1.0),
    "drive.sphere_radius_m": (0.005, 20.0),
    "drive.roller_radius_m": (0.0001, 2.0),
    "drive.row_distance_m": (0.0, 2.0),
    "drive.wheels.azimuth_deg": (-720.0, 720.0),
    "drive.wheels.below_equator_deg": (-90.0, 90.0),
    "drive.wheels.turn_deg": (-720.0, 720.0),
    "drive.height_m": (0.0, 20.0),
    "drive.parts.size_m": (0.0005, 40.0),
    "drive.parts.at_m": (-20.0, 20.0),
    "drive.parts.rpy_deg": (-720.0, 720.0),
    "drive.joints.at_m": (-20.0, 20.0),
    "drive.joints.rpy_deg": (-720.0, 720.0),
    "drive.joints.axis": (-1.001, 1.001),
    "servo.no_load_speed_rpm": (0.1, 10_000.0),
    "servo.approach_rate_per_s": (0.05, 5000.0),
    "servo.stall_torque_nm": (0.0005, 1e9),
    "servo.size_m": (0.001, 5.0),
    "motor.signal": (-1e6, 1e6),
    "motor.speed_rpm": (0.0, 300_000.0),
    "motor.start_speed_rpm": (0.0, 300_000.0),
    "motor.time_constant_up_s": (0.0005, 20.0),
    "motor.time_constant_down_s": (0.0005, 20.0),
    "motor.pulse_low_us": (20.0, 20_000.0),
    "motor.pulse_high_us": (20.0, 20_000.0),
    "motor.arming_hold_s": (0.0, 60.0),
    "motor.power_w": (0.001, 1e9),
    "motor.gear_ratio": (0.01, 10_000.0),
    "motor.no_load_speed_rpm": (1.0, 300_000.0),
    "motor.rotor_inertia_kg_m2": (1e-13, 1e5),
    "motor.time_constant_s": (0.0005, 20.0),
    "motor.current_limit": (0.001, 10.0),
    "motor.temperature_limit_c": (10.0, 1000.0),
    "mass.total_kg": (0.002, 2e7),
    "mass.wheel_kg": (1e-5, 1e6),
    "mass.gimbal_kg": (1e-5, 1e6),
    "mass.sphere_kg": (0.0005, 1e7),
    "mass.yaw_inertia_kg_m2": (1e-8, 1e10),
    "noise.gimbal_angle_deg": (0.0, 45.0),
    "noise.speed_scale_sigma": (0.0, 1.0),
    "noise.creep_m": (0.0, 0.5),
    "gyro.noise_rad_per_s": (0.0, 1.0),
    "gyro.bias_rad_per_s": (0.0, 1.0),
    "calibration.tilt_offset_deg": (-90.0, 90.0),
    "calibration.spin_scale": (0.5, 2.0),
    "floor.friction": (0.0, 20.0),
    "floor.patch_radius_m": (1e-6, 0.5),
    "gyro.scale_share": (0.0, 1.0),
    "errors.mount_deg": (0.0, 45.0),
    "errors.place_m": (0.0, 5.0),
    "errors.slope_deg": (0.0, 30.0),
    "errors.zero_deg": (0.0, 45.0),
    "errors.dead_band_deg": (0.0, 45.0),
    "errors.backlash_deg": (0.0, 45.0),
    "errors.delay_s": (0.0, 5.0),
    "errors.battery_share": (0.0, 1.0),
    "errors.motor_share": (0.0, 1.0),
    "errors.layer_m": (0.0, 0.05),
    "dead_wheels.radius_m": (0.0005, 5.0),
    "dead_wheels.pulses_per_turn": (1.0, 1e9),
    "dead_wheels.gyro_range_deg_per_s": (10.0, 100_000.0),
    "dead_wheels.gyro_drift_deg_per_h": (0.0, 1e6),
    "dead_wheels.radius_share": (0.0, 1.0),
    "dead_wheels.mounting_deg": (0.0, 90.0),
    "dead_wheels.wheels.x_m": (-20.0, 20.0),
    "dead_wheels.wheels.y_m": (-20.0, 20.0),
    "dead_wheels.wheels.direction_deg": (-720.0, 720.0),
}
"""Minimum and maximum of each number, by its path without list indices."""

_DEG = math.pi / 180.0
_UNITS: tuple[tuple[str, str, tuple[tuple[float, str], ...]], ...] = (
    ("_rad_per_s2", "rad/s²", ((_DEG, "°/s²"),)),
    ("_rad_per_s", "rad/s", ((_DEG, "°/s"),)),
    ("_deg_per_s", "°/s", ((1.0 / _DEG, "rad/s"),)),
    ("_deg_per_h", "°/h", ()),
    ("_kg_m2", "kg m²", ((1e-3, "g m²"), (1e-7, "g cm²"))),
    ("_per_s", "1/s", ((1e3, "1/ms"),)),
    ("_mps2", "m/s²", ((1e-3, "mm/s²"), (1e-2, "cm/s²"))),
    ("_mps", "m/s", ((1e-3, "mm/s"), (1e-2, "cm/s"))),
    ("_deg", "°", ((1.0 / _DEG, "rad"),)),
    ("_rpm", "rpm", ((60.0, "turns/s"), (30.0 / math.pi, "rad/s"))),
    ("_nm", "N m", ((1e-3, "N mm"), (1e-2, "N cm"))),
    ("_us", "µs", ((1e3, "ms"), (1e6, "s"))),
    ("_kg", "kg", ((1e-3, "g"),)),
    ("_share", "", ((1e-2, "%"),)),
    ("_m", "m", ((1e-3, "mm"), (1e-2, "cm"))),
    ("_s", "s", ((1e-3, "ms"), (1e-6, "µs"))),
    ("_v", "V", ((1e-3, "mV"),)),
    ("_w", "W", ((1e-3, "mW"), (1e3, "kW"))),
)
"""Key suffix, its unit, and easily confused units with their factors."""

_DIRECTIONS = re.compile(r".*(azimuths?|direction|roller|below_equator|turn)_deg")
_MAX_DENSITY_KG_PER_M3 = 22_600.0
"""Density of osmium, for a robot that fills a cube of its width."""


def range_problems(numbers: Sequence[tuple[str, float]]) -> Iterator[Problem]:
    """Yield the numbers outside their ranges, each with the probable intended unit."""
    for path, value in numbers:
        key = _key_of(path)
        least, most = RANGES.get(key, (-math.inf, math.inf))
        if not least <= value <= most:
            unit, others = next(
                ((unit, others) for end, unit, others in _UNITS if key.endswith(end)), ("", ())
            )
            yield (
                f"{path} is {_format(value, unit)}{_unit_hint(value, least, most, others)}",
                f"plausible is {least:g} to {_format(most, unit)}",
            )
    yield from _radian_problems(numbers)


def proportion_problems(
    wheel: tuple[str, float], reach: tuple[str, float], total_kg: float
) -> Iterator[Problem]:
    """Yield contradictions between wheel radius, distance of the wheels, and mass.

    Each of them alone may be plausible in a wrong unit. `wheel` and `reach` are pairs of key and
    metres.
    """
    (wheel_key, wheel_m), (reach_key, reach_m) = wheel, reach
    if wheel_m > 4.0 * reach_m:
        yield (
            f"{wheel_key} is {wheel_m:g} m, but {reach_key} puts no wheel farther than "
            f"{reach_m:g} m from the centre: did you mean {1e-3 * wheel_m:g} or "
            f"{1e-2 * wheel_m:g}, in metres?",
            "such wheels would be in each other's place",
        )
    elif reach_m > 400.0 * wheel_m:
        yield (
            f"{reach_key} puts a wheel {reach_m:g} m from the centre, but {wheel_key} is "
            f"{wheel_m:g} m: is one of them in millimetres or centimetres?",
            "plausible is up to 400 times the radius",
        )
    elif total_kg > _MAX_DENSITY_KG_PER_M3 * (2.0 * (reach_m + wheel_m)) ** 3:
        yield (
            f"mass.total_kg is {total_kg:g} kg, did you mean {1e-3 * total_kg:g}, which is "
            f"{total_kg:g} g?",
            f"a robot {2.0 * (reach_m + wheel_m):.2g} m wide would be denser than any metal",
        )


def _key_of(path: str) -> str:
    return re.sub(r"\[\d+\]", "", path)


def _format(value: float, unit: str) -> str:
    return f"{value:g}{unit}" if unit in ("", "°", "°/s", "°/h") else f"{value:g} {unit}"


def _unit_hint(value: float, least: float, most: float, others: Iterable[tuple[float, str]]) -> str:
    for factor, other in others:
        if least <= factor * value <= most:
            return f", did you mean {factor * value:.4g}, which is {_format(value, other)}?"
    return ""


def _radian_problems(numbers: Sequence[tuple[str, float]]) -> Iterator[Problem]:
    """Yield directions given in radians where degrees are expected.

    Small angles in degrees are plausible too, as on a measured robot. An angle counts as radians if
    its digits match a right angle, if three digits match a multiple of 15° from 30°, or if all of
    three or more angles are multiples of 5°.
    """
    angles = [
        (_key_of(path), path, value)
        for path, value in numbers
        if value and _DIRECTIONS.fullmatch(_key_of(path))
    ]
    for _, group in groupby(sorted(angles), key=lambda angle: angle[0]):
        listed = list(group)
        every = len(listed) > 2 and all(_is_multiple(value, 5, 2) for _, _, value in listed)
        for _, path, value in listed:
            known = _is_multiple(value, 90, 2) or (abs(value) > 0.5 and _is_multiple(value, 15, 3))
            if every or known:
                meant = 5.0 * round(value / _DEG / 5.0)
                yield (
                    f"{path} is {value:g}°, did you mean {meant:g}, which is {value:g} rad?",
                    "angles are in degrees; if so small a one is meant, give it one digit more",
                )


def _is_multiple(value: float, step_deg: int, least_digits: int) -> bool:
    """Return whether a number is a multiple of `step_deg` in radians, rounded to its digits."""
    if abs(value) > 2.0 * math.pi + 0.01:
        return False
    digits = len(repr(value).partition(".")[2])
    step = step_deg * _DEG
    nearest = step * round(value / step)
    return digits >= least_digits and round(nearest, min(digits, 12)) == round(value, 12)
