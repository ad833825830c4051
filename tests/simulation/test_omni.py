"""Omni platforms in virtual time obey Newton and Coulomb, and slip at excessive commands."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest

from tsd_twin import robots
from tsd_twin.lie import Array
from tsd_twin.robots import OmniDescription
from tsd_twin.simulation import Simulation, simulate

NAMES = ("omni4", "kiwi", "mecanum")
ROBOT = robots.load_robot("omni4")


def changed(robot: OmniDescription, **drive: Any) -> OmniDescription:
    return msgspec.structs.replace(robot, drive=msgspec.structs.replace(robot.drive, **drive))


def run(simulation: Simulation, twist: list[float] | Array, seconds: float) -> None:
    simulation.command(simulation.kinematics.inverse(np.asarray(twist, dtype=float)))
    for _ in range(round(seconds * 100)):
        simulation.advance(0.01)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("twist", [[0.3, 0.0, 0.0], [0.0, -0.3, 0.0], [0.0, 0.0, 1.0]])
def test_a_drive_ends_where_dead_reckoning_says(name: str, twist: list[float]) -> None:
    """Lag only delays the motion; starting at 0.3 m/s, a wheel may slip."""
    simulation = simulate(robots.load_robot(name))
    run(simulation, twist, 2.0)
    np.testing.assert_allclose(simulation.twist(), twist, atol=1e-4)
    run(simulation, [0.0, 0.0, 0.0], 1.0)
    np.testing.assert_allclose(simulation.pose.xy_heading, 2.0 * np.array(twist), atol=0.02)
    np.testing.assert_allclose(simulation.twist(), 0.0, atol=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_a_circle_closes(name: str) -> None:
    simulation = simulate(robots.load_robot(name))
    run(simulation, [0.3, 0.1, 1.0], 1.0)
    start = simulation.pose
    for _ in range(1000):
        simulation.advance(2.0 * np.pi / 1000)
    end = (start.inverse() @ simulation.pose).xy_heading
    np.testing.assert_allclose(end, [0.0, 0.0, 2.0 * np.pi], atol=1e-3)


def heaviest_push(simulation: Simulation, seconds: float) -> float:
    """Maximum acceleration of the body in the world, m/s^2."""
    velocity, most = simulation.pose.rotate(simulation.twist()[:2]), 0.0
    for _ in range(round(seconds / 0.0025)):
        simulation.advance(0.0025)
        now = simulation.pose.rotate(simulation.twist()[:2])
        most = max(most, float(np.hypot(*(now - velocity))) / 0.0025)
        velocity = now
    return most


def test_friction_is_all_that_pushes_a_robot() -> None:
    """At a step to 4 m/s, wheels spin; along X, four at 45 degrees push with mu g / sqrt 2."""
    simulation = simulate(ROBOT)
    simulation.command(simulation.kinematics.inverse(np.array([4.0, 0.0, 0.0])))
    most = heaviest_push(simulation, 0.3)
    assert most == pytest.approx(0.7 * 9.81 / np.sqrt(2.0), rel=0.02)
    slipping = np.abs(np.array(simulation.hardware_status()["slip_mps"]))
    assert slipping.min() > 0.3
    assert simulation.twist()[0] < 0.6 * 4.0
    assert np.abs(simulation.measure()[:4]).min() > 20.0  # The encoders do not show it.


def test_below_the_limit_of_friction_wheels_keep_their_grip() -> None:
    simulation = simulate(ROBOT)
    for i in range(100):
        simulation.command(simulation.kinematics.inverse(np.array([0.02 * i, 0.0, 0.0])))
        simulation.advance(0.01)
        assert np.abs(np.array(simulation.hardware_status()["slip_mps"])).max() < 0.02
    assert simulation.twist()[0] == pytest.approx(2.0, abs=0.08)


def test_less_friction_is_less_push() -> None:
    travelled = []
    for friction in (0.1, 0.2, 0.4):
        simulation = simulate(changed(ROBOT, friction=friction))
        run(simulation, [4.0, 0.0, 0.0], 0.3)
        travelled.append(simulation.pose.xy_heading[0] / friction)
    np.testing.assert_allclose(travelled, travelled[0], rtol=0.05)


def test_a_motor_gives_no_more_than_its_power() -> None:
    """With unlimited grip, m v dv/dt is at most four times 200 W."""
    simulation = simulate(changed(ROBOT, friction=1000.0))
    simulation.command(np.sign(simulation.kinematics.inverse(np.array([1.0, 0.0, 0.0]))) * 70.0)
    before, most = 0.0, 0.0
    for _ in range(400):
        simulation.advance(0.0025)
        speed = simulation.twist()[0]
        most = max(most, 15.0 * speed * (speed - before) / 0.0025)
        before = speed
    # The bound excludes the power that accelerates rotors and rims.
    assert 0.5 * 800.0 < most <= 800.0 * 1.02


def test_top_speed_falls_with_the_battery() -> None:
    tops = []
    for volts in (24.0, 18.0):
        simulation = simulate(ROBOT, battery_v=volts)
        simulation.command(np.full(4, -1000.0))
        for _ in range(300):
            simulation.advance(0.01)
        tops.append(np.abs(simulation.joints).max())
    assert tops[0] == pytest.approx(3600.0 * 2.0 * np.pi / 60.0 / 4.3, rel=0.02)
    assert tops[1] / tops[0] == pytest.approx(0.75, rel=0.02)


def test_a_soft_floor_swallows_its_share() -> None:
    simulation = simulate(changed(ROBOT, slip=0.1))
    run(simulation, [1.0, 0.0, 0.0], 2.0)
    assert simulation.twist()[0] == pytest.approx(0.9, abs=1e-3)
    np.testing.assert_allclose(
        simulation.kinematics.forward(simulation.measure()[:4]).twist, [1.0, 0.0, 0.0], atol=1e-3
    )


def test_a_batch_is_its_members() -> None:
    twists = np.random.default_rng(0).normal(size=(30, 2, 3, 3))
    together = simulate(ROBOT, (2, 3))
    alone = {at: simulate(ROBOT) for at in np.ndindex(2, 3)}
    drive = together.kinematics
    for twist in twists:
        together.command(drive.inverse(twist))
        together.advance(0.01)
        for at, one in alone.items():
            one.command(drive.inverse(twist[at]))
            one.advance(0.01)
    for at, one in alone.items():
        close = {"rtol": 1e-9, "atol": 1e-11}
        np.testing.assert_allclose(together.pose.xy_heading[at], one.pose.xy_heading, **close)
        np.testing.assert_allclose(together.measure()[at], one.measure(), **close)
        np.testing.assert_allclose(together.twist()[at], one.twist(), **close)


def test_finer_steps_change_little() -> None:
    """Five times finer steps move the end of a rough drive by millimetres."""
    ends = []
    for parts in (1, 5):
        simulation = simulate(ROBOT)
        for i in range(200):
            twist = np.array([2.0 * np.sin(0.05 * i), 1.0, 2.0 * np.cos(0.03 * i)])
            simulation.command(simulation.kinematics.inverse(twist))
            for _ in range(parts):
                simulation.advance(0.01 / parts)
        ends.append(simulation.pose.xy_heading)
    np.testing.assert_allclose(ends[0], ends[1], atol=0.02)


def test_dead_wheels_count_whole_pulses_and_the_gyro_ends_at_its_range() -> None:
    simulation = simulate(ROBOT)
    run(simulation, [0.5, 0.2, 0.0], 1.0)
    step = 2.0 * np.pi / 1024
    measured = simulation.measure()[4:]
    np.testing.assert_allclose(measured[:2] / step, np.round(measured[:2] / step), atol=1e-9)
    rolled = simulation.pose.xy_heading[:2] / 0.024
    np.testing.assert_allclose(measured[:2], rolled, atol=step)
    run(simulation, [0.0, 0.0, 8.0], 2.0)
    assert simulation.twist()[2] == pytest.approx(8.0, abs=0.1)
    assert simulation.measure()[6] == pytest.approx(np.radians(300.0))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_set_points_that_are_no_numbers_are_refused(bad: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        simulate(ROBOT).command(np.array([1.0, bad, 0.0, 0.0]))
