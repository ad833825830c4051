"""Changing the wheel speed during driving does not change the motion."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.controller_harness import (
    ROBOT,
    ControllerHarness,
    HarnessOperator,
    with_exact_setpoints,
)
from tsd_twin import robots
from tsd_twin.control.wheel_spin import WheelSpeedController
from tsd_twin.lie import Array
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.topics import Service
from tsd_twin.simulation import SimRobot

RPM = np.pi / 30.0
LEAST, MOST, USUAL = 2000.0, 13409.0, 2500.0
"""Lowest and highest speed of all motors in Table 1 of the thesis, and the default."""
MOST_AT_RATIO = 13603.0 / 1.5
"""Maximum speed of a drive whose first wheel has a ratio of 1.5."""
STEP_MPS_AT_1_RPM = 0.04 * RPM * 2.0 * np.pi / 4096

speeds = st.floats(LEAST, MOST) | st.sampled_from([LEAST, MOST, USUAL])


def choose(rig: ControllerHarness, pilot: HarnessOperator, rpm: float) -> None:
    reply = rig.ask(Service.SPEED, lease=pilot.lease, cruise_speed_rpm=rpm)
    assert reply.ok, reply.reason


def truth(rig: ControllerHarness) -> Array:
    assert rig.simulated is not None
    return rig.simulated.truth(rig.now_s).twist


def spins(rig: ControllerHarness) -> Array:
    """True wheel speeds, rpm."""
    assert rig.simulated is not None
    return rig.simulated.truth(rig.now_s).joints[rig.wheels] / RPM


@settings(max_examples=15)
@given(
    way=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-2, 2)),
    speed=st.floats(0.3, 1.0),
    chosen=st.lists(speeds, min_size=1, max_size=3),
    held_s=st.floats(0.05, 3.0),
)
def test_the_motion_stays_what_it_was_while_the_wheels_change_speed(
    way: tuple[float, float, float], speed: float, chosen: list[float], held_s: float
) -> None:
    """For any twist and choice, also during an earlier change: within 2 % and one servo step."""
    wanted = np.array(way) + 1e-3
    wanted *= speed / max(np.hypot(*wanted[:2]), abs(wanted[2]) / 3.0, 1e-9)
    rig = ControllerHarness(SimRobot(ROBOT))
    pilot = rig.get_ready()
    rig.drive(pilot, wanted, 1.0)
    asked = rig.controller.twist.copy()
    for rpm in chosen:
        choose(rig, pilot, rpm)
        for _ in range(round(held_s / 0.02)):
            rig.drive(pilot, wanted, 0.02)
            np.testing.assert_allclose(rig.controller.twist, asked, rtol=1e-9)
            # Each servo is off by up to half a step, and pivots are 0.15 m from the centre.
            step = STEP_MPS_AT_1_RPM * spins(rig).max()
            off = truth(rig) - asked
            assert np.hypot(*off[:2]) <= 0.02 * np.hypot(*asked[:2]) + step
            assert abs(off[2]) <= 0.02 * abs(asked[2]) + step / 0.15


@pytest.mark.parametrize("rpm", [LEAST, 4000.0, MOST])
def test_the_wheels_come_to_the_speed_that_was_chosen_and_show_it(rpm: float) -> None:
    robot = with_exact_setpoints(ROBOT)
    rig = ControllerHarness(SimRobot(robot), robot=robot)
    pilot = rig.get_ready()
    wheel_speed = rig.status().wheel_speed
    assert wheel_speed is not None
    assert (wheel_speed.requested_rpm, wheel_speed.spin_rpm) == (
        USUAL,
        pytest.approx(USUAL, rel=0.03),
    )
    rig.drive(pilot, (0.8, 0.0, 0.0), 0.5)
    choose(rig, pilot, rpm)
    rig.drive(pilot, (0.8, 0.0, 0.0), 10.0)
    np.testing.assert_allclose(spins(rig), rpm, rtol=0.01)
    wheel_speed = rig.status().wheel_speed
    assert wheel_speed is not None
    assert (wheel_speed.requested_rpm, wheel_speed.spin_rpm) == (rpm, pytest.approx(rpm, rel=0.01))
    # By rolling: v = r_w spin sin(tilt).
    joints = rig.setpoint.reshape(-1, 3)
    leaning = np.arccos(np.cos(joints[:, 0]) * np.cos(joints[:, 1]))
    np.testing.assert_allclose(leaning, np.arcsin(0.8 / (0.04 * rpm * RPM)), rtol=1e-3)


def test_too_slow_for_the_command_it_is_scaled_as_a_whole_and_no_gimbal_goes_too_far() -> None:
    """A robot may drive at 6 m/s, but its wheels reach only 4.2 m/s at 30° tilt."""
    text = robots.read_description("tsd").replace("speed_mps = 1.0", "speed_mps = 6.0")
    text = text.replace("stop_allowance_m = 0.35", "stop_allowance_m = 5.0")
    robot = robots.parse_description(text, "fast")
    rig = ControllerHarness(SimRobot(robot), robot=robot)
    pilot = rig.get_ready()
    choose(rig, pilot, 4000.0)
    way = np.array([5.0, 2.0, 0.0])
    rig.drive(pilot, way, 5.0)
    np.testing.assert_allclose(rig.twist, way, rtol=1e-6)
    choose(rig, pilot, LEAST)
    for _ in range(250):
        before = rig.twist
        rig.drive(pilot, way, 0.02)
        joints = rig.setpoint.reshape(-1, 3)
        leaning = np.arccos(np.cos(joints[:, 0]) * np.cos(joints[:, 1]))
        assert leaning.max() <= np.radians(30.0) + 1e-9
        # Same direction, and braking within the limits.
        assert abs(rig.twist[0] * way[1] - rig.twist[1] * way[0]) < 1e-6
        assert np.hypot(*(rig.twist - before)[:2]) <= 6.0 * 0.02 * (1 + 1e-9)
    top = 0.04 * LEAST * RPM * 0.5
    assert np.hypot(*rig.twist[:2]) == pytest.approx(top, rel=1e-3)
    assert rig.status().limits.applied == pytest.approx(top / np.hypot(*way[:2]), abs=2e-3)


@pytest.mark.parametrize("way", [(0.0, 0.0, 60.0), (3.0, 1.0, 50.0), (-2.0, 4.0, -30.0)])
def test_wheels_that_slow_down_faster_than_it_may_do_not_bend_its_way(
    way: tuple[float, float, float],
) -> None:
    """A robot that turns fast but accelerates slowly still follows its commanded path."""
    text = robots.read_description("tsd")
    for key, was, now in (
        ("speed_mps", "1.0", "15.0"),
        ("turn_rate_rad_per_s", "3.0", "100.0"),
        ("angular_acceleration_rad_per_s2", "20.0", "5.0"),
    ):
        assert f"\n{key} = {was}" in text
        text = text.replace(f"\n{key} = {was}", f"\n{key} = {now}", 1)
    robot = with_exact_setpoints(robots.parse_description(text, "fast"))
    rig = ControllerHarness(robot=robot)
    pilot = rig.get_ready()
    choose(rig, pilot, 13000.0)
    rig.drive(pilot, way, 14.0)
    choose(rig, pilot, LEAST)
    for _ in range(300):
        rig.drive(pilot, way, 0.02)
        wheel_speed = rig.controller.kinematics
        assert float(wheel_speed.joint_utilization(rig.twist)) <= 1.0 + 1e-9
        done = wheel_speed.forward(
            np.where(rig.wheels, wheel_speed.inverse(rig.twist), rig.setpoint)
        ).twist
        np.testing.assert_allclose(done, rig.twist, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(np.cross(rig.twist, way), 0.0, atol=1e-6)


@pytest.mark.parametrize("rpm", ["1999.9", "13409.1", "0", "-2500", "1e999", "-1e999"])
def test_what_the_motors_cannot_do_is_refused_with_what_they_can(
    rig: ControllerHarness, rpm: str
) -> None:
    pilot = rig.get_ready()
    before = rig.setpoint.copy()
    payload = f'{{"lease": "{pilot.lease}", "cruise_speed_rpm": {rpm}}}'.encode()
    reply = rig.controller.serve(Service.SPEED, payload, rig.now_s)
    assert not reply.ok
    if "e999" not in rpm:
        assert reply.why == because(Code.WHEEL_SPEED_REFUSED, least_rpm=2000, most_rpm=13409)
    rig.wait(0.5)
    np.testing.assert_array_equal(rig.setpoint[rig.wheels], before[rig.wheels])


@pytest.mark.parametrize("value", ["NaN", '"fast"', "null", "[3000]"])
def test_what_is_no_number_is_refused(rig: ControllerHarness, value: str) -> None:
    pilot = rig.acquire()
    payload = f'{{"lease": "{pilot.lease}", "cruise_speed_rpm": {value}}}'.encode()
    reply = rig.controller.serve(Service.SPEED, payload, rig.now_s)
    assert not reply.ok
    assert reply.why is not None
    assert reply.why.code == Code.BAD_SHAPE


def test_only_the_holder_chooses_and_a_late_request_of_another_lease_does_nothing(
    rig: ControllerHarness,
) -> None:
    alice = rig.get_ready()
    bob = rig.acquire("bob", take_over=True)
    late = rig.ask(Service.SPEED, lease=alice.lease, cruise_speed_rpm=5000.0)
    assert (late.ok, late.why) == (False, because(Code.HELD_BY, holder="bob"))
    choose(rig, bob, 3000.0)
    choose(rig, bob, 3000.0)  # Repeated requests are idempotent.
    rig.drive(bob, (0, 0, 0), 2.0)
    np.testing.assert_allclose(rig.setpoint[rig.wheels], 3000.0 * RPM)


def test_a_thousand_requests_a_second_move_nothing_and_are_not_answered_by_a_flood() -> None:
    """Requests alternate between the holder, an operator without a lease, and an invalid lease."""
    rig, alone = ControllerHarness(SimRobot(ROBOT)), ControllerHarness(SimRobot(ROBOT))
    pilots = [each.get_ready() for each in (rig, alone)]
    rig.controller.take_events()
    way = (0.5, 0.3, 0.6)
    random = np.random.default_rng(0)
    before = rig.setpoint[rig.wheels]
    for i in range(200):
        for lease, rpm in (
            (pilots[0].lease, MOST if i % 2 else LEAST),
            (pilots[0].lease, random.uniform(-1e5, 1e5)),
            (pilots[0].lease, "fast"),
            ("0" * 32, 5000.0),
            ("nobody", 5000.0),
        ):
            rig.ask(Service.SPEED, lease=lease, cruise_speed_rpm=rpm)
            rig.ask(Service.SPEED, lease=lease, cruise_speed_rpm=rpm)
        for each, pilot in zip((rig, alone), pilots, strict=True):
            each.drive(pilot, way, 0.01)
        np.testing.assert_allclose(rig.controller.twist, alone.controller.twist, atol=1e-9)
        # A change of under 1 % per period keeps motors with a lag of 0.12 s within 10 %.
        assert (np.abs(rig.setpoint[rig.wheels] - before) < 0.01 * before).all()
        before = rig.setpoint[rig.wheels].copy()
    assert rig.mode is Mode.DRIVING
    assert len(rig.controller.take_events()) < 50


def test_chosen_before_arming_it_is_what_the_wheels_spin_up_to() -> None:
    rig = ControllerHarness(SimRobot(ROBOT))
    pilot = rig.acquire()
    choose(rig, pilot, 4000.0)
    rig.wait(0.5)
    assert not rig.setpoint[rig.wheels].any()
    rig.ask(Service.ARM, lease=pilot.lease)
    rig.drive(pilot, (0, 0, 0), 3.5)
    assert rig.mode is Mode.READY
    np.testing.assert_allclose(spins(rig), 4000.0, rtol=0.03)


@pytest.mark.parametrize("end", [Service.DISARM, Service.STOP])
def test_wheels_that_are_shut_off_stand_and_forget_what_was_chosen(
    rig: ControllerHarness, end: Service
) -> None:
    pilot = rig.get_ready()
    choose(rig, pilot, 4000.0)
    rig.drive(pilot, (0.5, 0.0, 0.0), 3.0)
    rig.ask(end, lease=pilot.lease)
    rig.drive(pilot, (0, 0, 0), 1.0)
    assert not rig.setpoint[rig.wheels].any()
    if end is Service.STOP:
        refused = rig.ask(Service.SPEED, lease=pilot.lease, cruise_speed_rpm=4000.0)
        assert (refused.ok, refused.why) == (False, because(Code.RESET_FIRST, mode="stopped"))
        rig.ask(Service.RESET, lease=pilot.lease)
    rig.ask(Service.ARM, lease=pilot.lease)
    rig.drive(pilot, (0, 0, 0), 3.0)
    assert rig.mode is Mode.READY
    np.testing.assert_allclose(rig.setpoint[rig.wheels], USUAL * RPM)


def test_a_new_holder_finds_spinning_wheels_as_they_are_and_standing_ones_as_described(
    rig: ControllerHarness,
) -> None:
    alice = rig.acquire("alice")
    choose(rig, alice, 5000.0)
    bob = rig.acquire("bob", take_over=True)
    rig.tick()
    wheel_speed = rig.status().wheel_speed
    assert wheel_speed is not None
    assert wheel_speed.requested_rpm == USUAL
    choose(rig, bob, 3000.0)
    rig.ask(Service.ARM, lease=bob.lease)
    rig.drive(bob, (0, 0, 0), 4.0)
    rig.acquire("alice", take_over=True)
    rig.wait(1.0)
    assert rig.mode is Mode.READY
    np.testing.assert_allclose(rig.setpoint[rig.wheels], 3000.0 * RPM)


def test_a_robot_whose_wheels_stand_when_it_does_has_no_speed_to_choose() -> None:
    rig = ControllerHarness(robot=robots.load_robot("omni4"))
    pilot = rig.acquire()
    reply = rig.ask(Service.SPEED, lease=pilot.lease, cruise_speed_rpm=3000.0)
    assert not reply.ok
    assert reply.why == because(Code.NO_WHEEL_SPEED)
    assert rig.status().wheel_speed is None


@pytest.mark.parametrize("end", ["least", "most"])
def test_a_machine_whose_wheels_turn_otherwise_than_described_has_no_speed_they_do_not_reach(
    end: str,
) -> None:
    """At both ends of the range, all wheels reach the speed that the controller assumes."""
    found = "\n[calibration]\nspin_scale = [1.1, 0.9, 1.0]\n"
    robot = robots.parse_description(robots.read_description("tsd") + found, "mine")
    assert robot.wheel_speed_range is not None
    rpm = {
        "least": robot.wheel_speed_range.least_rad_per_s,
        "most": robot.wheel_speed_range.most_rad_per_s,
    }[end] / RPM
    assert rpm == pytest.approx({"least": 2000.0 * 1.1, "most": 13445.0 * 0.9}[end])
    rig = ControllerHarness(SimRobot(robot), robot=robot)
    pilot = rig.acquire()
    choose(rig, pilot, rpm)
    rig.ask(Service.ARM, lease=pilot.lease)
    rig.drive(pilot, (0, 0, 0), 6.0)
    np.testing.assert_allclose(spins(rig), rpm, rtol=0.01)
    before = rig.ask(Service.SPEED, lease=pilot.lease, cruise_speed_rpm=0.999 * rpm)
    beyond = rig.ask(Service.SPEED, lease=pilot.lease, cruise_speed_rpm=1.001 * rpm)
    assert (before.ok, beyond.ok) == (end == "most", end == "least")


@given(speeds)
@settings(max_examples=10)
def test_wheels_that_shall_not_turn_alike_keep_their_ratio_in_every_gear(rpm: float) -> None:
    """The chosen speed applies to a wheel of ratio 1; the twist does not change."""
    ratio = np.array([1.5, 1.0, 1.2])
    text = robots.read_description("tsd").replace(
        "[limits]", f"spin_ratio = {ratio.tolist()}\n\n[limits]", 1
    )
    ramp = WheelSpeedController(robots.parse_description(text, "mine"))
    twist = np.array([0.3, -0.2, 0.5])
    refusal = ramp.choose(rpm, b"")
    assert bool(refusal) == (rpm > MOST_AT_RATIO)
    for _ in range(3):
        ramp.advance(0.01, b"", lambda setpoint, _: float(setpoint[2::3].mean()), armed=False,
                        ramps=False)  # fmt: skip
    joints = ramp.kinematics.inverse(twist)
    ramp.set_wheels(joints)
    wanted = USUAL if refusal else rpm
    np.testing.assert_allclose(joints[2::3], wanted * RPM * ratio, rtol=1e-9)
    np.testing.assert_allclose(ramp.kinematics.forward(joints).twist, twist, atol=1e-9)
    status = ramp.status(float(joints[2::3].mean()))
    assert status is not None
    assert status.spin_rpm == pytest.approx(wanted, abs=0.1)
