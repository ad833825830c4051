"""The robot stops, and remains at rest until a new deliberate command."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.controller_harness import ControllerHarness, HarnessOperator
from tsd_twin import robots
from tsd_twin.control import RobotController
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.topics import Service


def still(rig: ControllerHarness) -> bool:
    """Check that gimbals are commanded upright and wheels to zero speed."""
    return not rig.setpoint.any() and not rig.twist.any()


def at_one_metre_a_second(rig: ControllerHarness, direction: float = 0.0) -> HarnessOperator:
    pilot = rig.get_ready()
    rig.drive(pilot, (np.cos(direction), np.sin(direction), 0.0), 1.5)
    assert np.hypot(*rig.twist[:2]) == pytest.approx(1.0)
    return pilot


@pytest.mark.parametrize("direction", [0.0, 0.4, np.pi / 2, 3.0])
def test_from_one_metre_a_second_it_stands_within_35_cm_of_the_last_command(
    sim_rig: ControllerHarness, direction: float
) -> None:
    pilot = at_one_metre_a_second(sim_rig, direction)
    sim_rig.send(pilot, (np.cos(direction), np.sin(direction), 0.0))
    sim_rig.tick()
    last = sim_rig.truth()
    speeds = []
    for _ in range(100):
        sim_rig.tick()
        speeds.append(float(np.hypot(*sim_rig.simulated.truth(sim_rig.now_s).twist[:2])))
    travelled = np.hypot(*(sim_rig.truth() - last)[:2])
    assert sim_rig.mode is Mode.READY
    assert speeds[-1] < 1e-3
    assert 0.25 < travelled <= 0.35
    assert speeds[15] > 0.95  # A gap of up to 200 ms in the commands is not a stop.


def test_the_software_stop_is_shorter_than_the_controlled_one(sim_rig: ControllerHarness) -> None:
    at_one_metre_a_second(sim_rig)
    before = sim_rig.truth()
    sim_rig.controller.stop(b"", sim_rig.now_s)
    sim_rig.tick()
    assert still(sim_rig)
    sim_rig.wait(1.0)
    # Gimbal servos limit the braking: 5.5° of tilt, approached exponentially at 32 /s.
    assert np.hypot(*(sim_rig.truth() - before)[:2]) < 0.06
    assert sim_rig.mode is Mode.STOPPED


def test_letting_go_brakes_at_the_limit_and_ends_ready(rig: ControllerHarness) -> None:
    pilot = at_one_metre_a_second(rig)
    rig.send(pilot, (0.0, 0.0, 0.0))
    speeds = []
    for _ in range(19):
        rig.tick()
        speeds.append(rig.twist[0])
    np.testing.assert_allclose(np.diff(speeds[:16]), -0.06, atol=1e-12)
    assert speeds[-1] == 0.0
    assert rig.mode is Mode.READY


def test_after_a_stop_nothing_moves_until_reset_and_arm_and_a_new_command(
    sim_rig: ControllerHarness,
) -> None:
    rig = sim_rig
    pilot = at_one_metre_a_second(rig)
    assert rig.ask(Service.STOP).ok
    rig.tick()
    last = rig.sample(pilot, (1.0, 0.0, 0.0))
    for _ in range(60):  # The stick is still held.
        rig.drive(pilot, (1.0, 0.0, 0.0), 0.02)
        assert still(rig)
    assert rig.ask(Service.RESET, lease=pilot.lease).why == because(Code.RELEASE_FIRST)
    rig.drive(pilot, (0.0, 0.0, 0.0), 0.6)
    assert rig.ask(Service.ARM, lease=pilot.lease).ok is False
    assert rig.ask(Service.RESET, lease=pilot.lease).ok
    rig.drive(pilot, (0.0, 0.0, 0.0), 0.5)
    assert rig.mode is Mode.DISARMED
    assert still(rig)
    rig.drive(pilot, (1.0, 0.0, 0.0), 0.5)
    assert still(rig)
    assert rig.ask(Service.ARM, lease=pilot.lease).ok
    rig.drive(pilot, (0.0, 0.0, 0.0), 3.0)
    assert rig.mode is Mode.READY
    rig.inbox = [last]
    rig.tick()
    assert not rig.twist.any()
    rig.drive(pilot, (1.0, 0.0, 0.0), 0.02)
    # The limiter starts from rest, without a jump to the speed before the stop.
    assert 0.0 < rig.twist[0] <= 2 * 0.04 + 1e-9


@pytest.mark.parametrize("name", robots.robot_names())
@pytest.mark.parametrize("end", ["stop", "disarm", "fault"])
def test_a_command_held_back_over_a_stop_and_the_next_arming_moves_nothing(
    name: str, end: str
) -> None:
    """The lease allows an age of 1 s, and a robot without gimbals rearms within that."""
    rig = ControllerHarness(robot=robots.load_robot(name))
    pilot = rig.get_ready(max_age_s=1.0)
    rig.drive(pilot, (0.2, 0.0, 0.0), 0.5)
    late = rig.sample(pilot, (0.2, 0.0, 0.0), seq=10_000)
    if end == "stop":
        rig.ask(Service.STOP, operator="bob")
    elif end == "disarm":
        rig.drive(pilot, (0.0, 0.0, 0.0), 0.3)
        assert rig.ask(Service.DISARM, lease=pilot.lease).ok
    else:
        rig.measures = False
        rig.wait(0.15)
        rig.measures = True
    rig.wait(0.52)
    if end != "disarm":
        assert rig.ask(Service.RESET, lease=pilot.lease).ok
    assert rig.ask(Service.ARM, lease=pilot.lease).ok
    while rig.mode is Mode.ARMING:
        rig.ask(Service.LEASE, op="renew", operator=pilot.name, lease=pilot.lease)
        rig.tick()
    assert rig.mode is Mode.READY
    rig.inbox = [late]
    for _ in range(50):
        rig.tick()
        assert not rig.twist.any()
    assert rig.mode is Mode.READY
    rig.drive(pilot, (0.2, 0.0, 0.0), 0.1)
    assert rig.mode is Mode.DRIVING


def test_a_command_sent_while_arming_and_held_back_moves_nothing() -> None:
    rig = ControllerHarness(robot=robots.load_robot("kiwi"))
    pilot = rig.acquire(max_age_s=1.0)
    assert rig.ask(Service.ARM, lease=pilot.lease).ok
    late = rig.sample(pilot, (0.2, 0.0, 0.0))
    rig.wait(0.2)
    assert rig.mode is Mode.READY
    rig.inbox = [late]
    rig.wait(0.1)
    assert not rig.twist.any()


def test_a_zero_that_is_too_old_still_stops_the_robot_but_does_not_keep_the_lease(
    rig: ControllerHarness,
) -> None:
    pilot = at_one_metre_a_second(rig)
    old = rig.status_seq
    for _ in range(10):
        rig.drive(pilot, (1.0, 0.0, 0.0), 0.1)
    words, left_s = rig.controller.supervisor.heartbeat.counter, rig.status().lease.remaining_s
    rig.inbox = [rig.sample(pilot, (0.0, 0.0, 0.0), status_seq=old)]
    rig.tick()
    assert rig.twist[0] < 1.0
    assert rig.controller.supervisor.heartbeat.counter == words
    assert rig.status().lease.remaining_s < left_s
    rig.wait(0.25)
    assert not rig.twist.any()


def test_replayed_commands_of_a_whole_drive_move_nothing(rig: ControllerHarness) -> None:
    pilot = rig.get_ready()
    drive = []
    for _ in range(100):
        drive.append(rig.sample(pilot, (1.0, 0.0, 0.0)))
        rig.inbox = [drive[-1]]
        rig.tick()
    rig.drive(pilot, (0.0, 0.0, 0.0), 1.0)
    accepted = rig.status().command.accepted
    rig.inbox = drive
    rig.wait(1.0)
    assert not rig.twist.any()
    assert rig.status().command.accepted == accepted
    assert rig.status().command.dropped.order == 100


def test_who_stops_measuring_stops_driving_and_is_in_fault(sim_rig: ControllerHarness) -> None:
    rig = sim_rig
    pilot = at_one_metre_a_second(rig)
    rig.measures = False
    rig.drive(pilot, (1.0, 0.0, 0.0), 0.08)
    assert rig.mode is Mode.DRIVING
    rig.drive(pilot, (1.0, 0.0, 0.0), 0.06)
    assert rig.mode is Mode.FAULT
    assert rig.status().stop.code == Code.JOINTS_SILENT
    assert still(rig)
    rig.measures = True
    rig.drive(pilot, (1.0, 0.0, 0.0), 1.0)
    assert rig.mode is Mode.FAULT
    assert still(rig)


def test_without_news_of_the_joints_the_estimate_comes_to_rest_with_the_wheels(
    sim_rig: ControllerHarness,
) -> None:
    rig = sim_rig
    pilot = at_one_metre_a_second(rig)
    rig.measures = False
    before = rig.pose
    rig.drive(pilot, (1.0, 0.0, 0.0), 20.0)
    assert np.abs(rig.controller.odometry(0).twist).max() < 1e-6
    assert rig.pose[0] - before[0] < 0.6


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_a_gimbal_that_measures_no_number_counts_as_not_measured(
    rig: ControllerHarness, number: float
) -> None:
    rig.get_ready()
    joints = np.zeros(9)
    joints[3] = number
    for _ in range(20):
        rig.now_s += 0.01
        rig.controller.step(rig.now_s, joints, ())
    assert rig.mode is Mode.FAULT
    assert np.isfinite(rig.pose).all()
    assert np.isfinite(rig.controller.joints).all()


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_a_wheel_that_measures_no_number_is_modelled(rig: ControllerHarness, number: float) -> None:
    rig.get_ready()
    joints = np.where(rig.wheels, number, 0.0)
    for _ in range(20):
        rig.now_s += 0.01
        rig.controller.step(rig.now_s, joints, ())
    assert rig.mode is Mode.READY
    assert np.isfinite(rig.pose).all()
    np.testing.assert_allclose(rig.controller.joints[rig.wheels], 2500 * np.pi / 30, rtol=0.02)


def test_joints_that_are_not_measured_from_the_start_cannot_be_armed(
    rig: ControllerHarness,
) -> None:
    rig.measures = False
    rig.wait(0.5)
    pilot = rig.acquire()
    reply = rig.ask(Service.ARM, lease=pilot.lease)
    assert not reply.ok
    assert reply.why is not None
    assert reply.why.code == Code.JOINTS_SILENT
    rig.tick()
    assert rig.mode is Mode.DISARMED
    assert still(rig)


def test_gimbals_found_tilted_are_where_it_starts_from_and_no_motion(
    rig: ControllerHarness,
) -> None:
    tilted = np.where(rig.wheels, np.nan, 0.4)
    controller = RobotController(rig.controller.robot, lambda: bytes(16))
    for i in range(5):
        controller.step(0.01 * i, None, ())
    for i in range(5, 10):
        controller.step(0.01 * i, tilted, ())
    np.testing.assert_allclose(controller.odometry(0).xy_heading, 0.0, atol=1e-12)


def test_a_loop_that_stalls_while_driving_does_not_leap_afterwards(rig: ControllerHarness) -> None:
    pilot = at_one_metre_a_second(rig)
    rig.inbox = [rig.sample(pilot, (-1.0, 0.0, 0.0)) for _ in range(100)]
    rig.tick(1.0)
    assert not rig.twist.any()
    assert rig.status().command.dropped.stale == 100
