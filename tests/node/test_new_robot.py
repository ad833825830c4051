"""A robot of a known kind is one TOML file: written, loaded, and driven in virtual time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support.bus_operator import BusOperator
from tests.support.virtual_fleet import VirtualNode
from tests.support.virtual_time import VirtualClock
from tsd_twin import robots
from tsd_twin.lie import SO3
from tsd_twin.messages.cdr import decode_odometry
from tsd_twin.messages.topics import Sample

FIVE_WHEELS = """
name = "star"
title = "Five omni wheels"

[drive]
kind = "omni"
wheel_radius_m = 0.04
wheels = [
  { x_m = 0.2, y_m = 0.0, direction_deg = 90.0 },
  { x_m = 0.06, y_m = 0.19, direction_deg = 162.0 },
  { x_m = -0.16, y_m = 0.12, direction_deg = 234.0 },
  { x_m = -0.16, y_m = -0.12, direction_deg = 306.0 },
  { x_m = 0.06, y_m = -0.19, direction_deg = 18.0 },
]

[limits]
speed_mps = 1.0
turn_rate_rad_per_s = 2.0
acceleration_mps2 = 2.0
deceleration_mps2 = 2.5
angular_acceleration_rad_per_s2 = 8.0

[motor]
power_w = 40.0
gear_ratio = 15.0
no_load_speed_rpm = 6000.0
rotor_inertia_kg_m2 = 2e-6
time_constant_s = 0.03

[battery]
nominal_v = 12.0

[mass]
total_kg = 6.0
wheel_kg = 0.2
yaw_inertia_kg_m2 = 0.12
"""
FOUR_MODULES = (
    robots.read_description("tsd")
    .replace('name = "tsd"', 'name = "quad"')
    .replace("[90.0, 210.0, 330.0]", "[45.0, 135.0, 225.0, 315.0]")
    .replace("speed_rpm = [\n", f"speed_rpm = [\n  {[0, 0, *range(3000, 14000, 1400)]},\n")
    .replace("[motor]", "[motor]\narming_hold_s = 0.1")
)


@pytest.mark.parametrize("text", [FIVE_WHEELS, FOUR_MODULES], ids=["star", "quad"])
def test_a_robot_that_is_one_file_drives(text: str, tmp_path: Path, clock: VirtualClock) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    robot = robots.load_robot(str(path))
    node = VirtualNode(clock, robot.name, robots.read_description(str(path)))
    with BusOperator(node) as pilot:
        pilot.get_ready()
        pilot.drive((0.3, 0.2, 0.0), until=lambda: pilot.truth.xy_heading[0] > 0.3)
        told, true = (decode_odometry(each.payload) for each in pilot.together("odom", "truth"))
        x, y, _ = true.xy_heading
        assert y == pytest.approx(x * 2.0 / 3.0, abs=0.05)
        np.testing.assert_allclose(told.xy_heading, true.xy_heading, atol=0.05)


def test_a_robot_with_two_estimates_sends_both(clock: VirtualClock) -> None:
    text = robots.read_description("omni4").replace("friction = 0.7", "friction = 0.7\nslip = 0.2")
    with BusOperator(VirtualNode(clock, "omni4", text), streams=6) as pilot:
        pilot.get_ready()
        pilot.drive((0.5, 0.0, 0.0), until=lambda: pilot.truth.xy_heading[0] > 0.5)
        samples = pilot.together("odom", "truth", "odom_alternative")
        best, true, other = (decode_odometry(each.payload).xy_heading[0] for each in samples)
        assert best == pytest.approx(true, abs=0.05)
        assert other > 1.1 * true


def test_a_sphere_turns_about_the_axis_that_it_is_told(clock: VirtualClock) -> None:
    node = VirtualNode(clock, "atlas", robots.read_description("atlas"))
    with BusOperator(node, streams=6) as pilot:

        def read(sample: Sample) -> SO3:
            wxyz = decode_odometry(sample.payload, turning=True).wxyz
            assert wxyz is not None
            return SO3(wxyz)

        pilot.get_ready()
        pilot.drive((0.0, 2.0, 0.0), until=lambda: read(pilot.newest["truth"]).log()[1] > 1.0)
        told, true = map(read, pilot.together("odom", "truth"))
        turned = true.log()
        # Row changes push it slightly sideways, which the estimate includes.
        assert np.abs(turned[[0, 2]]).max() < 0.1 * turned[1]
        off = (told @ true.inverse()).log()
        assert np.linalg.norm(off) < 0.1
