"""A number in a wrong unit is rejected with a suggestion; robots of all sizes load."""

from __future__ import annotations

import json
import re
import typing
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest
import tomlkit
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import fields

from tsd_twin.errors import RobotFileError
from tsd_twin.robots import (
    DESCRIPTIONS,
    RobotDescription,
    load_robot,
    parse_description,
    read_description,
    robot_names,
)
from tsd_twin.robots.plausibility import RANGES
from tsd_twin.tables import Table

EXPONENTS = {
    "_kg_m2": 5.0,
    "_kg": 3.0,
    "_nm": 4.0,
    "_w": 3.5,
    "_mps2": 0.0,
    "_mps": 0.5,
    "_m": 1.0,
    "_rad_per_s2": -1.0,
    "_rad_per_s": -0.5,
    "_per_s": -0.5,
    "_rpm": -0.5,
    "time_constant_s": 0.5,
    "time_constant_up_s": 0.5,
    "time_constant_down_s": 0.5,
}
"""Exponent of the scale factor by which a quantity grows (Froude's law)."""


def changed(name: str, old: str, new: str) -> str:
    text = read_description(name)
    assert old in text
    return text.replace(old, new, 1)


def refusal(toml: str) -> str:
    with pytest.raises(RobotFileError) as caught:
        parse_description(toml, "my.toml")
    message = str(caught.value)
    assert message.startswith("my.toml: ")
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    ("name", "old", "new", "says"),
    [
        ("kiwi", "wheel_radius_m = 0.029", "wheel_radius_m = 29.0",
         "drive.wheel_radius_m is 29 m, did you mean 0.029, which is 29 mm? "
         "(plausible is 0.0005 to 5 m)"),
        ("kiwi", "wheel_radius_m = 0.029", "wheel_radius_m = 2.9", "did you mean 0.0029 or 0.029"),
        ("kiwi", "x_m = 0.06", "x_m = 160.0",
         "drive.wheels[0].x_m is 160 m, did you mean 0.16, which is 160 mm?"),
        ("kiwi", "x_m = -0.12", "x_m = -12.0", "drive.wheels puts a wheel 12 m from the centre"),
        ("kiwi", "speed_mps = 0.8", "speed_mps = 800",
         "limits.speed_mps is 800 m/s, did you mean 0.8, which is 800 mm/s?"),
        ("kiwi", "turn_rate_rad_per_s = 4.0", "turn_rate_rad_per_s = 180",
         "limits.turn_rate_rad_per_s is 180 rad/s, did you mean 3.142, which is 180°/s?"),
        ("kiwi", "total_kg = 1.8", "total_kg = 1800", "did you mean 1.8, which is 1800 g?"),
        ("kiwi", "time_constant_s = 0.03", "time_constant_s = 30",
         "did you mean 0.03, which is 30"),
        ("kiwi", "nominal_v = 7.4", "nominal_v = 7400", "did you mean 7.4, which is 7400 mV?"),
        ("kiwi", "direction_deg = 150.0", "direction_deg = 2.618",
         "drive.wheels[0].direction_deg is 2.618°, did you mean 150, which is 2.618 rad?"),
        ("omni4", "direction_deg = -45.0", "direction_deg = -0.785", "mean -45, which is -0.785"),
        ("mecanum", "roller_deg = -45.0", "roller_deg = -0.7854", "did you mean -45, which is"),
        ("tsd", "[90.0, 210.0, 330.0]", "[1.57, 3.67, 5.76]",
         "drive.azimuths_deg[0] is 1.57°, did you mean 90, which is 1.57 rad?"),
        ("tsd", "max_tilt_deg = 30.0", "max_tilt_deg = 0.52",
         "drive.max_tilt_deg is 0.52°, did you mean 29.79, which is 0.52 rad?"),
        ("tsd", "pivot_radius_m = 0.15", "pivot_radius_m = 150", "mean 0.15, which is 150 mm?"),
        ("tsd", "start_speed_rpm = 2000.0", "start_speed_rpm = 2000.0\npulse_low_us = 1.0",
         "motor.pulse_low_us is 1 µs, did you mean 1000, which is 1 ms?"),
        ("atlas", "sphere_radius_m = 0.15", "sphere_radius_m = 150.0",
         "did you mean 0.15, which is 150 mm?"),
        ("atlas", "stop_allowance_m = 0.2", "stop_allowance_m = 200",
         "limits.stop_allowance_m is 200 m, did you mean 0.2, which is 200 mm?"),
    ],
)  # fmt: skip
def test_a_number_in_another_unit_is_refused_with_the_one_that_was_meant(
    name: str, old: str, new: str, says: str
) -> None:
    assert says in refusal(changed(name, old, new))


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        # Mecanum wheels of a measured robot, almost straight ahead.
        ("mecanum", "direction_deg = 0.0", "direction_deg = 0.35"),
        ("mecanum", "direction_deg = 0.0", "direction_deg = -1.2"),
        ("mecanum", "direction_deg = 0.0", "direction_deg = 0.262"),
        ("mecanum", "direction_deg = 0.0", "direction_deg = 0.7851"),
        ("kiwi", "direction_deg = 150.0", "direction_deg = -210.0"),
        ("kiwi", "direction_deg = 30.0", "direction_deg = 30.5236"),
        ("tsd", "wheel_radius_m = 0.04", "wheel_radius_m = 0.08"),
    ],
)
def test_what_can_be_built_is_not_refused(name: str, old: str, new: str) -> None:
    parse_description(changed(name, old, new), "my.toml")


def scaled(text: str, size: float) -> dict[str, Any]:
    """Return a built-in robot scaled by `size`."""

    def walk(value: Any, key: str = "") -> Any:
        if isinstance(value, dict):
            return {name: walk(inner, name) for name, inner in value.items()}
        if isinstance(value, list):
            return [walk(inner, key) for inner in value]
        if not isinstance(value, float):
            return value
        power = next((power for end, power in EXPONENTS.items() if key.endswith(end)), 0.0)
        return value * size**power

    return walk(msgspec.to_builtins(parse_description(text, "shipped")))


def widths_m(robot: RobotDescription) -> float:
    """Return the approximate width of a robot."""
    drive = msgspec.to_builtins(robot)["drive"]
    if "pivot_radius_m" in drive:
        reach_m = drive["pivot_radius_m"]
    elif "sphere_radius_m" in drive:
        reach_m = drive["sphere_radius_m"]
    else:
        reach_m = max((wheel["x_m"] ** 2 + wheel["y_m"] ** 2) ** 0.5 for wheel in drive["wheels"])
    return 2.0 * (reach_m + drive["wheel_radius_m"])


@given(st.sampled_from(robot_names()), st.floats(0.05, 20.0))
def test_every_shipped_robot_can_be_built_from_5_cm_to_20_m(name: str, width_m: float) -> None:
    size = width_m / widths_m(load_robot(name))
    tables = json.loads(json.dumps(scaled(read_description(name), size)))
    built = parse_description(tomlkit.dumps(without_none(tables)), "my.toml")
    assert widths_m(built) == pytest.approx(width_m)


def without_none(value: Any) -> Any:
    """Return the tables without empty values, which TOML cannot write."""
    if isinstance(value, dict):
        return {key: without_none(inner) for key, inner in value.items() if inner is not None}
    return [without_none(inner) for inner in value] if isinstance(value, list) else value


def numbers(kind: Any, path: str = "") -> Iterator[str]:
    """Yield the paths of all numbers in the tables of a description."""
    hints = typing.get_type_hints(kind, include_extras=True)
    for name, hint in ((each.encode_name, hints[each.name]) for each in fields(kind)):
        if name.endswith("_rgba"):
            continue  # Colour components, limited by their type.
        inside = [part for part in flat(hint) if isinstance(part, type)]
        for part in inside:
            if issubclass(part, Table):
                yield from numbers(part, f"{path}{name}.")
        if float in inside:
            yield f"{path}{name}"


def flat(hint: Any) -> Iterator[Any]:
    yield hint
    for inside in typing.get_args(hint):
        yield from flat(inside)


def test_every_number_of_a_description_has_a_range() -> None:
    known = {path for kind in DESCRIPTIONS.values() for path in numbers(kind)}
    assert known == set(RANGES)


def test_the_ranges_are_wide() -> None:
    """Four times up and down from each scale-dependent number of a built-in robot."""
    for name in robot_names():
        for path, value in leaves(msgspec.to_builtins(load_robot(name))):
            if path in RANGES and value > 0.0 and not path.endswith(("_deg", "_share")):
                least, most = RANGES[path]
                ratio = 2.0 if path in ("calibration.spin_scale", "drive.slip") else 4.0
                assert least <= value / ratio, path
                assert value * ratio <= most, path


def leaves(value: Any, path: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(value, float):
        yield re.sub(r"\[\d+\]", "", path), value
    elif isinstance(value, dict):
        for key, inner in value.items():
            yield from leaves(inner, f"{path}.{key}" if path else key)
    elif isinstance(value, list):
        for inner in value:
            yield from leaves(inner, path)
