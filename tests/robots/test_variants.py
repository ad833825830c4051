"""Variants of built-in robots: parameters, their checks, and the file that describes them."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tsd_twin.dashboard.sessions.variants import (
    base_robot,
    knobs_of,
    value_at,
    variant,
    variant_toml,
)
from tsd_twin.errors import RobotFileError
from tsd_twin.robots import load_robot, parse_description, robot_names

calm = settings(max_examples=60)


@st.composite
def changes(draw: st.DrawFn) -> tuple[str, dict[str, float]]:
    """A built-in robot with random values for some of its parameters."""
    base = draw(st.sampled_from(robot_names()))
    knobs = knobs_of(base_robot(base))
    keys = draw(st.lists(st.sampled_from(sorted(knobs)), unique=True, max_size=6))
    return base, {key: draw(st.floats(knobs[key].least, knobs[key].most)) + 0.0 for key in keys}


@pytest.mark.parametrize("base", robot_names())
def test_every_shipped_robot_is_within_the_ranges_of_its_knobs(base: str) -> None:
    knobs = knobs_of(base_robot(base))
    assert len(knobs) >= 4
    assert variant(base, {key: knob.value for key, knob in knobs.items()}) == load_robot(base)
    assert len({knob.label for knob in knobs.values()}) == len(knobs)


@calm
@given(chosen=changes())
def test_the_file_of_a_variant_is_the_variant(chosen: tuple[str, dict[str, float]]) -> None:
    base, turned = chosen
    try:
        robot = variant(base, turned)
    except RobotFileError:
        with pytest.raises(RobotFileError):
            variant_toml(base, turned)
        return
    loaded = parse_description(variant_toml(base, turned), "my.toml")
    own_words = {"name": robot.name, "title": robot.title, "assumptions": robot.assumptions}
    assert msgspec.structs.replace(loaded, **own_words) == robot
    twists = np.random.default_rng(1).normal(size=(20, 3))
    assert np.array_equal(
        loaded.kinematics().joint_utilization(twists), robot.kinematics().joint_utilization(twists)
    )


@calm
@given(chosen=changes())
def test_only_the_turned_knobs_change(chosen: tuple[str, dict[str, float]]) -> None:
    base, turned = chosen
    try:
        after = knobs_of(variant(base, turned))
    except RobotFileError:
        return
    before = knobs_of(base_robot(base))
    assert {key: knob.value for key, knob in after.items()} == {
        key: turned.get(key, knob.value) for key, knob in before.items()
    }


def test_a_variant_keeps_the_comments_and_names_what_was_changed() -> None:
    text = variant_toml("tsd", {"drive.pivot_radius_m": 0.2, "drive.azimuths_deg.0": 80.0})
    assert "# Table 1 of the thesis." in text
    table: Any = tomllib.loads(text)
    assert table["drive"]["pivot_radius_m"] == 0.2
    assert table["drive"]["azimuths_deg"] == [80.0, 210.0, 330.0]
    assert table["name"] == "my-tsd"
    assert "changed: drive.pivot_radius_m is 0.2, was 0.15" in table["assumptions"]
    plain: Any = tomllib.loads(variant_toml("tsd", {}))
    assert plain["assumptions"] == list(load_robot("tsd").assumptions)


def test_a_file_of_a_variant_runs_as_a_robot(tmp_path: Path) -> None:
    path = tmp_path / "my.toml"
    path.write_text(variant_toml("mecanum", {"drive.wheels.3.roller_deg": 30.0}), "utf-8")
    wheels = value_at(msgspec.to_builtins(load_robot(str(path))), "drive.wheels")
    assert [wheel["roller_deg"] for wheel in wheels][3] == 30.0


@pytest.mark.parametrize(
    ("turned", "problem"),
    [
        ({"drive.pivot_radius_m": 9.0}, "from 0.05 to 0.6"),
        ({"drive.pivot_radius_m": math.nan}, "from 0.05 to 0.6"),
        ({"drive.pivot_radius_m": math.inf}, "from 0.05 to 0.6"),
        ({"body.meshes": 1.0}, "is no knob"),
        ({"drive.azimuths_deg.3": 1.0}, "is no knob"),
        ({"drive": 1.0}, "is no knob"),
        ({"drive.azimuths_deg.0": 210.0}, "the same direction twice"),
        ({"drive.cruise_speed_rpm": 900.0}, "motor.start_speed_rpm"),
    ],
)
def test_what_no_file_may_have_no_variant_has(turned: dict[str, float], problem: str) -> None:
    with pytest.raises(RobotFileError, match=problem):
        variant("tsd", turned)
    with pytest.raises(RobotFileError, match=problem):
        variant_toml("tsd", turned)


@pytest.mark.parametrize("base", ["", "none", "../tsd", "/etc/passwd", "tsd.toml", "tsd\n"])
def test_only_shipped_robots_are_bases(base: str) -> None:
    """Pages send the name, so it must not lead to a file."""
    with pytest.raises(RobotFileError, match="no such robot"):
        variant(base, {})


def test_a_variant_does_not_change_its_base() -> None:
    before = msgspec.to_builtins(load_robot("tsd"))
    variant("tsd", {"drive.azimuths_deg.0": 80.0})
    assert msgspec.to_builtins(base_robot("tsd")) == before
