"""The independent plants against cases with an analytic solution."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from tests.independent.built import Undeclared, loads
from tests.independent.patch import weights
from tests.independent.rollers import RollerPlant, SpherePlant, turned, turned_by
from tests.independent.singularity import SingularityPlant
from tsd_twin import robots

TSD: Any = robots.load_robot("tsd")
SPIN = 2500.0 * 2.0 * np.pi / 60.0
PERIOD_S = 0.01


def exact(robot: Any, **floor: float) -> Any:
    """The plant of a single robot without errors."""
    if floor:
        robot = msgspec.structs.replace(robot, floor=msgspec.structs.replace(robot.floor, **floor))
    return SingularityPlant(robot, 1, 0, errors=0.0, noise=0.0)


def joints(tilt_rad: float, towards: float = 0.0, spin: float = SPIN) -> np.ndarray:
    """Setpoints of a tsd whose axles all tip in the same direction of the floor."""
    out = []
    for azimuth in np.radians(TSD.drive.azimuths_deg):
        # The axle's level part, in the module: X is clockwise of the outward Y.
        level = np.sin(tilt_rad) * np.array([np.cos(towards), np.sin(towards)])
        x = level @ [np.sin(azimuth), -np.cos(azimuth)]
        y = level @ [np.cos(azimuth), np.sin(azimuth)]
        out += [np.arcsin(y), np.arctan2(x, np.sqrt(1.0 - x * x - y * y)), spin]
    return np.array(out)


# The patch.


def test_a_patch_that_only_slides_is_coulomb_and_one_that_only_spins_has_the_lever_of_hertz() -> (
    None
):
    slip, spin = np.array([[0.3, 0.4]]), np.array([0.0])
    c, offset, twisting = weights(np.array([8.0]), 0.0005, slip, spin)
    force = -c[:, None] * slip - offset
    np.testing.assert_allclose(np.hypot(*force[0]), 8.0, rtol=1e-5)
    np.testing.assert_allclose(force[0] / 8.0, [-0.6, -0.8], rtol=1e-5)
    assert abs(twisting[0]) < 1e-12
    # The mean distance from the centre under Hertzian pressure is 3 pi / 16 of the radius.
    _, _, twisting = weights(np.array([8.0]), 0.002, np.zeros((1, 2)), np.array([3000.0]))
    np.testing.assert_allclose(twisting, -8.0 * 3.0 * np.pi / 16.0 * 0.002, rtol=0.01)


def test_a_patch_that_spins_fast_slides_as_on_oil() -> None:
    """Contensou: mu N v over 8 / 3 pi of the speed of the rim."""
    slip = np.array([[0.001, 0.0]])
    c, offset, _ = weights(np.array([8.0]), 0.0005, slip, np.array([SPIN]))
    force = c * slip[:, 0] + offset[:, 0]
    expected = 8.0 * 0.001 / (8.0 / (3.0 * np.pi) * 0.0005 * SPIN)
    np.testing.assert_allclose(force, expected, rtol=0.05)


def test_the_loads_carry_the_weight_and_its_moments() -> None:
    places = np.array([[0.1, 0.1], [0.1, -0.1], [-0.2, 0.0]])
    found = loads(places, 30.0, np.array([[0.3, -0.2]]))[0]
    np.testing.assert_allclose(found.sum(), 30.0)
    np.testing.assert_allclose(found @ places, [-0.3, 0.2], atol=1e-12)


# Spinning wheels in gimbals.


@pytest.mark.parametrize("towards", [0.0, 1.0, 2.5])
def test_tipped_axles_roll_at_the_speed_of_their_contact(towards: float) -> None:
    """v = r w sin(tilt), at right angles to the axle; a tiny patch does not slide."""
    plant = exact(TSD, patch_radius_m=1e-7)
    plant.step_rad = 1e-9
    plant.command(joints(0.0))
    plant.advance(1.0)
    plant.command(joints(0.08, towards))
    plant.advance(1.0)
    expected = 0.04 * SPIN * np.sin(0.08)
    c, s = np.cos(plant.pose[0, 2]), np.sin(plant.pose[0, 2])
    vx, vy = plant.velocity[0]
    body = [c * vx + s * vy, -s * vx + c * vy]
    # The velocity of the lowest point is backwards: axle x up.
    np.testing.assert_allclose(
        body, [expected * np.sin(towards), -expected * np.cos(towards)], atol=2e-3 * expected
    )
    assert abs(plant.rate[0]) < 5e-3


def test_wheels_without_a_motor_are_braked_by_the_moment_of_their_patches() -> None:
    """I dw/dt = -mu N 3 pi / 16 a until rest, with no gain of energy."""
    plant = exact(TSD, friction=0.8, patch_radius_m=0.002)
    plant.up_s = plant.down_s = 1e9
    plant.spin[:] = 60.0
    deceleration = (
        0.8 * TSD.mass.total_kg * 9.81 / 3.0 * 3.0 * np.pi / 16.0 * 0.002 / plant.spin_inertia
    )
    energies = []
    for _ in range(20):
        plant.advance(PERIOD_S)
        energies.append(float(plant.energy[0]))
    np.testing.assert_allclose(plant.spin[0], 60.0 - 0.2 * deceleration, atol=0.02 * 60.0)
    assert (np.diff(energies) < 0.0).all()


def test_what_a_coasting_robot_loses_is_the_work_of_its_friction() -> None:
    plant = exact(TSD)
    plant.up_s = plant.down_s = 1e9
    plant.spin[:], plant.velocity[:], plant.rate[:] = SPIN, [0.3, -0.2], 0.5
    before, work = float(plant.energy[0]), 0.0
    for _ in range(60):
        plant.advance(0.0025)
        work += 0.0025 * float(plant.friction_power[0])
    lost = before - float(plant.energy[0])
    assert lost > 0.05
    # An implicit step loses a little more.
    assert 0.95 * lost < -work < lost


def test_a_gimbal_yields_by_the_torque_over_its_stiffness() -> None:
    """A push at the floor against the servo that acts as a spring near its goal."""
    plant = exact(TSD)
    plant.force[0, 0] = [3.0, 0.0]
    for _ in range(400):
        plant.force[0, 0] = [3.0, 0.0]
        plant.turn_gimbals()
    stiffness = (
        TSD.servo.stall_torque_nm
        * TSD.servo.approach_rate_per_s
        / (TSD.servo.no_load_speed_rpm * 2.0 * np.pi / 60.0)
    )
    np.testing.assert_allclose(plant.angles[0, 0, 1], -0.04 * 3.0 / stiffness, rtol=1e-3)


def test_a_slope_makes_a_robot_creep_by_the_viscous_slip_of_its_wheels() -> None:
    plant = SingularityPlant(TSD, 4, 0, errors=0.0, noise=0.0, undeclared=Undeclared(slope_deg=1.0))
    plant.command(joints(0.0))
    plant.advance(2.0)
    speed = np.hypot(*plant.velocity.T)
    # Sliding carries the entire downhill component of the weight.
    push = 9.81 * np.sin(np.radians(1.0))
    lag_s = 8.0 / (3.0 * np.pi) * 0.0005 * float(plant.spin.mean()) / (0.8 * 9.81)
    lean = push * TSD.mass.total_kg / 3.0 * 0.04 / 29.1 * 0.04 * float(plant.spin.mean())
    expected = np.hypot(push * lag_s, lean)
    np.testing.assert_allclose(speed, expected, rtol=0.25)


# Rollers.


def platform(name: str, **undeclared: float) -> RollerPlant:
    robot: Any = robots.load_robot(name)
    return RollerPlant(robot, 1, 0, noise=0.0, undeclared=Undeclared(**undeclared))


@pytest.mark.parametrize("name", ["kiwi", "omni4", "mecanum"])
def test_wheels_of_equal_speed_turn_or_drive_a_platform(name: str) -> None:
    """Kiwi and omni4 turn by r w / l; mecanum drives forward by r w."""
    plant, robot = platform(name), robots.load_robot(name)
    drive: Any = robot.drive
    plant.command(np.full(plant.count, 4.0))
    plant.advance(2.0)
    rim = 4.0 * drive.wheel_radius_m
    if name == "mecanum":
        np.testing.assert_allclose(plant.velocity[0], [rim, 0.0], atol=0.002 * rim)
    else:
        lever = np.hypot(drive.wheels[0].x_m, drive.wheels[0].y_m)
        sign = np.sign(
            np.sin(
                np.radians(drive.wheels[0].direction_deg)
                - np.arctan2(drive.wheels[0].y_m, drive.wheels[0].x_m)
            )
        )
        np.testing.assert_allclose(plant.rate, sign * rim / lever, rtol=0.002)
    np.testing.assert_allclose(plant.wheels.speed, 4.0, rtol=0.002)


def test_no_platform_accelerates_faster_than_friction_allows() -> None:
    """Coulomb: all rollers of a mecanum grip at 45 degrees, so mu g over root 2 at most."""
    plant = platform("mecanum")
    plant.wheels.stall = plant.wheels.limit = 1e3
    plant.command(np.full(4, 40.0))
    plant.advance(0.1)
    limit = 0.6 * 9.81 / np.sqrt(2.0)
    speed = plant.velocity[0, 0]
    assert 0.75 * limit * 0.1 < speed <= (limit + 0.05) * 0.1


def test_a_platform_without_torque_loses_the_work_of_its_friction() -> None:
    plant = platform("kiwi")
    plant.wheels.gain = plant.wheels.integral_per_s = 0.0
    plant.velocity[:], plant.rate[:] = [0.4, 0.1], 1.0
    before, work = float(plant.energy[0]), 0.0
    for _ in range(80):
        plant.advance(0.0025)
        work += 0.0025 * float(plant.friction_power[0])
    lost = before - float(plant.energy[0])
    assert lost > 0.0
    # Implicit Euler loses more than friction takes, never less.
    assert -work <= lost * 1.02


# The sphere.


def test_ideal_wheels_turn_a_sphere_by_the_ratio_of_the_radii() -> None:
    robot: Any = robots.load_robot("atlas")
    drive = msgspec.structs.replace(robot.drive, row_distance_m=0.0)
    plant = SpherePlant(msgspec.structs.replace(robot, drive=drive), 1, 0, noise=0.0)
    plant.command(np.full(3, 6.0))
    plant.advance(2.0)
    # Three equal wheels 40 degrees below the equator turn it about Z: w r = W R cos(40 degrees).
    expected = 6.0 * 0.025 / (0.15 * np.cos(np.radians(40.0)))
    np.testing.assert_allclose(plant.rate[0], [0.0, 0.0, expected], atol=2e-3)


def test_the_rows_take_turns_and_change_the_speed_of_the_sphere() -> None:
    """Weiss et al. 2008, Eq. 12: contacts d / 2 (R + r_r) to either side of the middle."""
    robot: Any = robots.load_robot("atlas")
    plant = SpherePlant(robot, 1, 0, noise=0.0)
    plant.command(np.full(3, 6.0))
    plant.advance(1.0)
    off = np.arcsin(0.0125 / (2.0 * (0.15 + 0.00485)))
    rates = []
    for _ in range(400):
        plant.advance(0.0025)
        rates.append(plant.rate[0, 2])
    levels = [6.0 * 0.025 / (0.15 * np.cos(np.radians(40.0) + sign * off)) for sign in (-1, 1)]
    np.testing.assert_allclose([min(rates), max(rates)], levels, rtol=0.005)


def test_rotation_vectors_are_inverse_to_rotation_matrices() -> None:
    vectors = np.random.default_rng(0).standard_normal((50, 3))
    np.testing.assert_allclose(turned(turned_by(vectors)), vectors, atol=1e-9)
    np.testing.assert_allclose(turned(turned_by(1e-9 * vectors)), 1e-9 * vectors, atol=1e-15)


def test_the_plants_use_nothing_of_the_project() -> None:
    for name in ("patch", "built", "singularity", "rollers"):
        text = (Path(__file__).parent / f"{name}.py").read_text(encoding="utf-8")
        assert "from tsd_twin" not in text, name
