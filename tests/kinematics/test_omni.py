"""Wheels with rollers against the paper's rows, another library, and rigid-body rollers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from wpimath.geometry import Translation2d
from wpimath.kinematics import ChassisSpeeds, MecanumDriveKinematics

from tests.kinematics.random_kinematics import directions, omni_drives
from tsd_twin import robots
from tsd_twin.kinematics import OmniKinematics
from tsd_twin.kinematics.omni import layout_problem
from tsd_twin.lie import Array

calm = settings(max_examples=60)
Z = np.array([0.0, 0.0, 1.0])
WHEELS = {
    "wheel_radius_m": 0.05,
    "max_speed_rad_per_s": 50.0,
    "max_acceleration_rad_per_s2": 100.0,
}


def flat(angle: float) -> Array:
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def test_the_rows_are_those_of_the_paper() -> None:
    """Eq. 8 to 11 of Savnani et al.: wheels at 45, 135, 225 and 315 degrees, l from the centre."""
    kinematics = robots.load_robot("omni4").kinematics()
    half, length = np.sqrt(2.0) / 2.0, 0.18 * np.sqrt(2.0)
    rows = np.array(
        [
            [half, -half, -length],
            [half, half, -length],
            [-half, half, -length],
            [-half, -half, -length],
        ]
    )
    np.testing.assert_allclose(
        kinematics.speeds_from_twist, rows / 0.0762, rtol=0, atol=1e-12 / kinematics.wheel_radius_m
    )


@given(twist=st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_mecanum_agrees_with_wpimath(twist: tuple[float, float, float]) -> None:
    kinematics = robots.load_robot("mecanum").kinematics()
    peer = MecanumDriveKinematics(*[Translation2d(x, y) for x, y in kinematics.positions_m])
    wheels = peer.toWheelSpeeds(ChassisSpeeds(*twist))
    theirs = [wheels.frontLeft, wheels.frontRight, wheels.rearLeft, wheels.rearRight]
    ours = kinematics.wheel_radius_m * (kinematics.speeds_from_twist @ np.array(twist))
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12)


@calm
@given(kinematics=omni_drives(), direction=directions())
def test_rollers_slip_only_where_they_roll_freely(
    kinematics: OmniKinematics, direction: Array
) -> None:
    """Rigid bodies: hub on the chassis, rim about the hub, roller about its axle in the rim.

    A roller can spin at any rate, which moves its lowest point across its axle only. So there is a
    rate at which that point rests on the floor, if and only if it moves across.
    """
    twist = direction / kinematics.joint_utilization(direction)
    speeds = kinematics.inverse(twist)
    turning = twist[2] * Z
    for i in range(kinematics.wheels):
        at = np.append(kinematics.positions_m[i], 0.0)
        forward = flat(kinematics.directions_rad[i])
        axle = flat(kinematics.directions_rad[i] + kinematics.rollers_rad[i])
        hub = np.array([twist[0], twist[1], 0.0]) + np.cross(turning, at)
        # A wheel that drives forward turns about the axis to its left.
        rim = hub + np.cross(
            turning + speeds[i] * np.cross(Z, forward), -kinematics.wheel_radius_m * Z
        )
        roller = 0.2 * kinematics.wheel_radius_m
        per_spin = np.cross(axle, -roller * Z)
        spin = -(rim @ per_spin) / (per_spin @ per_spin)
        speed = np.abs(twist).max() * (1.0 + np.abs(kinematics.positions_m).max())
        np.testing.assert_allclose(rim + spin * per_spin, 0.0, atol=1e-9 * speed)


def test_straight_strafe_and_turn_look_right() -> None:
    """Front left and rear right wheels of a Mecanum robot run backwards when it moves left."""
    kinematics = robots.load_robot("mecanum").kinematics()
    straight, strafe, turn = (kinematics.inverse(np.eye(3)[i]) for i in range(3))
    assert (np.sign(straight) == [1, 1, 1, 1]).all()
    assert (np.sign(strafe) == [-1, 1, 1, -1]).all()
    assert (np.sign(turn) == [-1, 1, -1, 1]).all()


PARALLEL = ([[0.1, 0.1], [0.1, -0.1], [-0.1, 0.1]], [0.0, 0.0, 180.0], [0.0] * 3)
THROUGH_A_POINT = ([[0.2, 0.0], [0.0, 0.2], [-0.1, 0.1]], [0.0, 90.0, 135.0], [0.0] * 3)
WRONG_MECANUM = (
    [[0.1, 0.1], [0.1, -0.1], [-0.1, 0.1], [-0.1, -0.1]],
    [0.0] * 4,
    [45.0] * 4,
)


@pytest.mark.parametrize(
    ("layout", "says"),
    [
        (PARALLEL, "no wheel can push the robot towards"),
        (THROUGH_A_POINT, "no wheel can turn the robot about the point x = 0 m, y = 0 m"),
        (WRONG_MECANUM, "no wheel can push the robot towards"),
        (([[0.1, 0.0], [0.0, 0.1]], [90.0, 180.0], [0.0, 0.0]), "2 wheels cannot move"),
        (([[0.1, 0.0]] * 3, [90.0, 0.0, 30.0], [0.0, 90.0, 0.0]), "the rollers of wheel 2"),
    ],
    ids=["parallel", "through a point", "rollers all alike", "two wheels", "no grip"],
)
def test_layouts_that_cannot_work_are_refused_with_what_they_cannot_do(
    layout: tuple[list[list[float]], list[float], list[float]], says: str
) -> None:
    positions, wheels, rollers = (np.array(part) for part in layout)
    arguments = positions, np.radians(wheels), np.radians(rollers)
    assert says in layout_problem(*arguments)
    with pytest.raises(ValueError, match=says[:20]):
        OmniKinematics(*arguments, **WHEELS)


@pytest.mark.parametrize(("layout", "towards"), [(PARALLEL, 90.0), (WRONG_MECANUM, 135.0)])
def test_the_way_that_is_named_is_the_one_that_no_wheel_can_push(
    layout: tuple[list[list[float]], list[float], list[float]], towards: float
) -> None:
    positions, wheels, rollers = (np.array(part) for part in layout)
    said = layout_problem(positions, np.radians(wheels), np.radians(rollers))
    angle = float(said.split("towards ")[1].split()[0])
    assert (angle - towards) % 180.0 == pytest.approx(0.0, abs=1e-6)


def test_a_wheel_that_disagrees_with_three_others_is_blamed() -> None:
    """With four wheels all are equally suspect; a fifth one distinguishes them."""
    angles = np.arange(5) * 2.0 * np.pi / 5
    positions = 0.2 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    kinematics = OmniKinematics(positions, angles + np.pi / 2, 0.0 * angles, **WHEELS)
    for guilty in range(5):
        speeds = kinematics.inverse(np.array([0.3, -0.2, 0.5]))
        speeds[guilty] += 1.0
        residual = kinematics.forward(speeds).residual
        assert kinematics.fault_contribution(residual).argmax() == guilty
        assert kinematics.fault_contribution(residual)[guilty] == pytest.approx(residual @ residual)


def test_a_drive_does_not_change() -> None:
    kinematics = robots.load_robot("kiwi").kinematics()
    for array in (
        kinematics.speeds_from_twist,
        kinematics.twist_from_speeds,
        kinematics.grip_from_twist,
    ):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
