"""Knobs of a description: numbers in its tables that can be changed one at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Knob:
    """A number of a description, or the same number of each entry of a list."""

    key: str
    """Keys of the tables, separated by dots; `*` stands for each entry of a list."""
    label: str
    """With `{}` for the number of the entry, counted from 1."""
    unit: str
    least: float
    most: float
    step: float

    def places(self, tables: Any) -> Iterator[tuple[str, str]]:
        """Yield the key of each number in `tables`, and its label."""
        before, star, after = self.key.partition("*")
        if not star:
            yield self.key, self.label
            return
        for i in range(len(value_at(tables, before.rstrip(".")))):
            yield f"{before}{i}{after}", self.label.format(i + 1)


def value_at(tables: Any, key: str) -> Any:
    """Return the value at a key; entries of lists are counted from 0."""
    for part in key.split("."):
        tables = tables[int(part) if isinstance(tables, list) else part]
    return tables


def set_value(tables: Any, key: str, value: float) -> None:
    """Set the number at a key."""
    above, _, last = key.rpartition(".")
    table = value_at(tables, above)
    table[int(last) if isinstance(table, list) else last] = value


_WHEEL_RADIUS = Knob("drive.wheel_radius_m", "Wheel radius", "m", 0.01, 0.2, 0.001)
_GEARED_MOTOR = (
    Knob("motor.gear_ratio", "Gear ratio", "", 1.0, 60.0, 0.1),
    Knob("motor.no_load_speed_rpm", "Motor speed, no load", "rpm", 500.0, 15000.0, 100.0),
)
SINGULARITY_KNOBS = (
    Knob("drive.pivot_radius_m", "Pivot radius", "m", 0.05, 0.6, 0.005),
    _WHEEL_RADIUS,
    Knob("drive.max_tilt_deg", "Tilt limit", "°", 2.0, 60.0, 1.0),
    Knob("drive.cruise_speed_rpm", "Drive speed", "rpm", 500.0, 15000.0, 50.0),
    Knob("drive.azimuths_deg.*", "Azimuth {}", "°", -360.0, 360.0, 5.0),
)
"""Knobs of a singularity drive."""
OMNI_KNOBS = (
    _WHEEL_RADIUS,
    *_GEARED_MOTOR,
    Knob("drive.wheels.*.x_m", "Wheel {} forward", "m", -0.6, 0.6, 0.01),
    Knob("drive.wheels.*.y_m", "Wheel {} left", "m", -0.6, 0.6, 0.01),
    Knob("drive.wheels.*.direction_deg", "Wheel {} direction", "°", -360.0, 360.0, 5.0),
    Knob("drive.wheels.*.roller_deg", "Wheel {} roller", "°", -80.0, 80.0, 5.0),
)
"""Knobs of a platform on wheels with rollers."""
SPHERE_KNOBS = (
    Knob("drive.sphere_radius_m", "Sphere radius", "m", 0.05, 0.6, 0.005),
    _WHEEL_RADIUS,
    *_GEARED_MOTOR,
    Knob("drive.wheels.*.azimuth_deg", "Wheel {} azimuth", "°", -360.0, 360.0, 5.0),
    Knob("drive.wheels.*.below_equator_deg", "Wheel {} below equator", "°", -80.0, 80.0, 5.0),
    Knob("drive.wheels.*.turn_deg", "Wheel {} turn", "°", -180.0, 180.0, 5.0),
)
"""Knobs of a sphere on wheels."""
