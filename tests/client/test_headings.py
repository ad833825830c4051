"""Headings have the same range on the bus, in the simulator, and as goals."""

from __future__ import annotations

import math

import numpy as np

from tsd_twin import SimulatedRobot
from tsd_twin.lie import SE2
from tsd_twin.messages.cdr import decode_odometry, encode_odometry


def test_three_turns_on_the_spot_read_the_same_from_the_bus_and_in_the_simulator() -> None:
    read: list[float] = []
    counted: list[float] = []
    with SimulatedRobot("kiwi", pose=(0.0, 0.0, 3.0)) as robot, robot.control("script") as base:

        def turning(_: float) -> tuple[float, float, float] | None:
            turned = abs(counted[-1] - counted[0]) if counted else 0.0
            return (0.0, 0.0, 2.0) if turned < 6.1 * math.pi else None

        for _ in base.driving(turning):
            inside = robot.link.controller.odometry(0)
            counted.append(float(inside.xy_heading[2]))
            on_bus = decode_odometry(encode_odometry(inside)).xy_heading
            pose, truth = robot.state.odom.pose, robot.state.truth.pose
            np.testing.assert_allclose(pose, on_bus, atol=1e-12)
            assert -math.pi < pose.heading_rad <= math.pi
            assert -math.pi < truth.heading_rad <= math.pi
            read.append(pose.heading_rad)
    assert abs(counted[-1] - counted[0]) > 6.0 * math.pi
    jumps = [abs(step) for step in np.diff(read) if abs(step) > 1.0]
    assert len(jumps) == 4
    np.testing.assert_allclose(jumps, 2.0 * math.pi, atol=0.1)


def test_a_place_is_reached_on_the_shorter_way_from_both_sides_of_the_border() -> None:
    """The internal estimate counts turns, but a goal across the border is a small turn."""
    with SimulatedRobot("kiwi", pose=(0.0, 0.0, 3.0)) as robot, robot.control("script") as base:
        for heading_rad in (-3.0, 3.0, math.pi, -math.pi):
            began_s = robot.time_s
            base.go_to(x_m=0.0, y_m=0.1 * heading_rad, heading_rad=heading_rad)
            assert robot.time_s - began_s < 5.0
            off = robot.state.odom.se2.inverse() @ SE2(np.array([0.0, 0.0, heading_rad]))
            assert abs(math.remainder(off.xy_heading[2], math.tau)) < 0.1
