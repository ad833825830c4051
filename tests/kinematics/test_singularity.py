"""Inverse and forward kinematics of the singularity drive are inverses within its limits."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.kinematics.random_kinematics import (
    directions,
    drive_of,
    drives,
    joint_vectors,
    shares,
    size,
    within_limit,
)
from tests.kinematics.rigid_wheels import gimbals, in_robot_frame, pivots
from tsd_twin.kinematics import JointKind, SingularityKinematics
from tsd_twin.lie import SE2, Array
from tsd_twin.robots import RPM, load_robot


@given(kinematics=drives(), direction=directions(), share=shares)
def test_forward_undoes_inverse(
    kinematics: SingularityKinematics, direction: Array, share: float
) -> None:
    twist = within_limit(kinematics, direction, share)
    motion = kinematics.forward(kinematics.inverse(twist))
    tolerance = 1e-12 * size(kinematics, twist)
    np.testing.assert_allclose(motion.twist[:2], twist[:2], rtol=0, atol=tolerance)
    assert motion.twist[2] * kinematics.pivot_radius_m == pytest.approx(
        twist[2] * kinematics.pivot_radius_m, abs=tolerance
    )
    assert np.abs(motion.residual).max() <= tolerance


@given(kinematics=drives(), direction=directions(), excess=st.floats(1.0001, 1e6))
def test_too_much_is_scaled_as_a_whole(
    kinematics: SingularityKinematics, direction: Array, excess: float
) -> None:
    """Direction and curvature are kept, with one module at its limit and none beyond."""
    twist = within_limit(kinematics, direction, excess)
    joints = kinematics.inverse(twist)
    np.testing.assert_allclose(
        kinematics.forward(joints).twist,
        twist / excess,
        rtol=0,
        atol=1e-10 * size(kinematics, twist) / excess,
    )
    assert kinematics.joint_utilization(kinematics.limit(twist)) == pytest.approx(1.0, rel=1e-13)
    assert kinematics.tilt(joints).max() == pytest.approx(kinematics.max_tilt_rad, rel=1e-12)


@given(kinematics=drives(), direction=directions(), share=st.floats(0.0, 10.0))
def test_demand_is_the_tilt_that_a_twist_needs(
    kinematics: SingularityKinematics, direction: Array, share: float
) -> None:
    twist = within_limit(kinematics, direction, share)
    sines = [np.hypot(*gimbal[:2, 2]) for gimbal in gimbals(kinematics, kinematics.inverse(twist))]
    expected = min(share, 1.0) * np.sin(kinematics.max_tilt_rad)
    assert max(sines) == pytest.approx(expected, rel=1e-12, abs=1e-300)


@given(
    kinematics=drives(),
    a=directions(),
    b=directions(),
    share_a=shares,
    share_b=shares,
    dt_s=st.floats(1e-3, 1.0),
)
def test_rate_demand_bounds_the_speed_of_every_gimbal(
    kinematics: SingularityKinematics,
    a: Array,
    b: Array,
    share_a: float,
    share_b: float,
    dt_s: float,
) -> None:
    """Between any two twists within the tilt limit."""
    start, end = within_limit(kinematics, a, share_a), within_limit(kinematics, b, share_b)
    angles = (kinematics.inverse(end) - kinematics.inverse(start)).reshape(-1, 3)[:, :2]
    fastest = np.abs(angles).max() / dt_s
    bound = kinematics.rate_utilization(end - start, dt_s) * kinematics.max_tilt_rate_rad_per_s
    assert fastest <= bound * (1.0 + 1e-9) + 1e-12


def test_rate_demand_is_reached_by_the_worst_step() -> None:
    """The bound is tight."""
    kinematics = drive_of([0.5, 2.5, 4.5])
    angles = np.linspace(0.0, 2.0 * np.pi, 181)
    around = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=-1)
    limit = 1.0 / kinematics.joint_utilization(around)[:, None]
    start = around * limit * (1.0 - 2e-5)
    step = 1e-5 * limit[0] * around[:, None]
    moved = np.abs(kinematics.inverse(start + step) - kinematics.inverse(start)).max(axis=(1, 2))
    share = moved / (
        kinematics.rate_utilization(step[:, 0], 1.0) * kinematics.max_tilt_rate_rad_per_s
    )
    assert share.max() == pytest.approx(1.0, abs=1e-3)


def test_a_batch_is_its_members() -> None:
    kinematics = drive_of([0.3, 1.9, 4.0, 5.1])
    random = np.random.default_rng(0)
    twists, rates = random.normal(size=(4, 5, 3)), random.normal(size=(4, 5, 12))
    joints = kinematics.inverse(twists)
    motion = kinematics.forward(joints, rates)
    close = {"rtol": 1e-12, "atol": 1e-14}
    for at in np.ndindex(4, 5):
        one = kinematics.inverse(twists[at])
        alone = kinematics.forward(one, rates[at])
        np.testing.assert_allclose(joints[at], one, **close)
        np.testing.assert_allclose(motion.twist[at], alone.twist, **close)
        np.testing.assert_allclose(motion.residual[at], alone.residual, **close)
        np.testing.assert_allclose(
            kinematics.axles(twists)[at], kinematics.axles(twists[at]), **close
        )
        np.testing.assert_allclose(
            kinematics.joint_utilization(twists)[at],
            kinematics.joint_utilization(twists[at]),
            **close,
        )
        np.testing.assert_allclose(
            kinematics.limit(twists)[at], kinematics.limit(twists[at]), **close
        )
        np.testing.assert_allclose(kinematics.tilt(joints)[at], kinematics.tilt(one), **close)
        np.testing.assert_allclose(
            kinematics.rate_utilization(twists, 0.01)[at],
            kinematics.rate_utilization(twists[at], 0.01),
            **close,
        )
        np.testing.assert_allclose(
            kinematics.fault_contribution(motion.residual)[at],
            kinematics.fault_contribution(alone.residual),
            **close,
        )


@pytest.mark.parametrize("many", [0, 1, 4095, 4096, 4097, 10_000])
def test_a_large_batch_has_no_seams(many: int) -> None:
    kinematics = drive_of([0.3, 1.9, 4.0])
    twists = np.random.default_rng(1).normal(size=(many, 3))
    joints = kinematics.inverse(twists)
    assert joints.shape == (many, 9)
    limited = kinematics.limit(twists)
    np.testing.assert_allclose(kinematics.forward(joints).twist, limited, rtol=0, atol=1e-12)


def test_straight_strafe_and_turn_look_right() -> None:
    """A wheel that spins counter-clockwise and is tilted to the left drives forward."""
    kinematics = drive_of([np.pi / 2, np.pi / 2 + 2.0, np.pi / 2 + 4.0])
    for twist, lean in (([0.5, 0.0, 0.0], [0.0, 1.0]), ([0.0, 0.5, 0.0], [-1.0, 0.0])):
        axles = in_robot_frame(kinematics, kinematics.axles(np.array(twist)))
        tilt = 0.5 / (0.04 * 260.0)
        np.testing.assert_allclose(axles, np.tile(np.multiply(lean, tilt), (3, 1)), atol=1e-15)
    turn = kinematics.inverse(np.array([0.0, 0.0, 1.0])).reshape(-1, 3)
    # To turn left about the centre, all lean inwards equally, about their inner gimbal.
    np.testing.assert_allclose(turn[:, 0], -np.arcsin(0.15 / (0.04 * 260.0)), rtol=1e-12)
    np.testing.assert_allclose(turn[:, 1], 0.0, atol=1e-15)


def test_another_gear_needs_another_tilt() -> None:
    kinematics = drive_of([0.0, 2.0, 4.0])
    twist = np.array([0.8, -0.3, 1.0])
    fast = kinematics.with_spin(2.0 * kinematics.spin_rad_per_s)
    np.testing.assert_allclose(fast.axles(twist), kinematics.axles(twist) / 2.0, rtol=1e-14)
    np.testing.assert_allclose(fast.forward(fast.inverse(twist)).twist, twist, rtol=1e-12)


def test_the_figures_of_the_thesis() -> None:
    """At 2,500 rpm: 1 m/s is 5.5 degrees, 30 degrees is 5.2 m/s, a servo step is 16 mm/s."""
    robot = load_robot("tsd")
    kinematics = robot.kinematics().with_spin(2500.0 * RPM)
    forward = np.array([1.0, 0.0, 0.0])
    assert np.degrees(kinematics.tilt(kinematics.inverse(forward))) == pytest.approx(5.5, abs=0.05)
    assert np.degrees(kinematics.max_tilt_rad) == pytest.approx(30.0)
    assert 1.0 / kinematics.joint_utilization(forward) == pytest.approx(5.2, abs=0.05)
    step = np.zeros(9)
    step[0::3], step[2::3] = 2.0 * np.pi / 4096, 2500.0 * RPM
    np.testing.assert_allclose(
        np.linalg.norm(kinematics.contacts(step), axis=-1), 0.016, atol=0.0005
    )


def test_moving_follows_the_arc() -> None:
    """A quarter circle in 1 s ends one radius ahead and one to the left."""
    pose = drive_of([0.0, 2.0, 4.0]).integrate(SE2.identity(), np.array([1.0, 0.0, np.pi / 4]), 2.0)
    np.testing.assert_allclose(pose.xy_heading, [4 / np.pi, 4 / np.pi, np.pi / 2], rtol=1e-15)


def test_joints_are_named_module_by_module() -> None:
    kinematics = drive_of([0.0, 2.0])
    assert [(joint.name, joint.kind) for joint in kinematics.joints] == [
        ("module1_alpha", JointKind.POSITION),
        ("module1_beta", JointKind.POSITION),
        ("module1_wheel", JointKind.VELOCITY),
        ("module2_alpha", JointKind.POSITION),
        ("module2_beta", JointKind.POSITION),
        ("module2_wheel", JointKind.VELOCITY),
    ]
    np.testing.assert_allclose(kinematics.pivots_m, pivots(kinematics)[:, :2])


def test_a_drive_does_not_change() -> None:
    azimuths = np.array([0.0, 2.0, 4.0])
    kinematics = dataclasses.replace(drive_of([0.0]), azimuths_rad=azimuths)
    azimuths[0] = 1.0
    assert kinematics.azimuths_rad[0] == 0.0
    for array in (
        kinematics.azimuths_rad,
        kinematics.contact_from_twist,
        kinematics.twist_from_contacts,
    ):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


@given(data=st.data(), kinematics=drives())
def test_one_joint_vector_is_the_member_of_a_batch_to_the_bit(
    data: st.DataObject, kinematics: SingularityKinematics
) -> None:
    joints = data.draw(joint_vectors(kinematics)).reshape(-1)
    rates = data.draw(joint_vectors(kinematics)).reshape(-1)
    many, turning = np.tile(joints, (10, 1)), np.tile(rates, (10, 1))
    for one, batch in (
        (kinematics.contacts(joints), kinematics.contacts(many)),
        (kinematics.contacts(joints, rates), kinematics.contacts(many, turning)),
    ):
        np.testing.assert_array_equal(one, batch[0])
    np.testing.assert_array_equal(
        kinematics.twist(joints, rates), kinematics.forward(joints, rates).twist
    )


@given(kinematics=drives(), direction=directions(), factor=st.floats(0.0, 1e9))
def test_one_twist_is_the_member_of_a_batch(
    kinematics: SingularityKinematics, direction: Array, factor: float
) -> None:
    twist = factor * direction
    many = np.stack([twist, -twist])
    close = {"rtol": 1e-12, "atol": 1e-15}
    np.testing.assert_allclose(kinematics.inverse(twist), kinematics.inverse(many)[0], **close)
    np.testing.assert_allclose(
        kinematics.joint_utilization(twist), kinematics.joint_utilization(many)[0], **close
    )


@pytest.mark.parametrize("bad", [np.inf, np.nan, 1e308])
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning", "ignore:overflow")
def test_a_joint_that_is_no_number_is_no_exception(bad: float) -> None:
    kinematics = drive_of([0.0, 2.0, 4.0])
    joints = np.array([0.1, bad, 260.0, bad, 0.0, bad, 0.0, 0.0, 260.0])
    np.testing.assert_array_equal(
        kinematics.contacts(joints), kinematics.contacts(np.tile(joints, (4, 1)))[0]
    )
