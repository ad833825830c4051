"""Named scenarios: the robot drives as commanded."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.controller_harness import ControllerHarness
from tsd_twin.lie import Array
from tsd_twin.messages.modes import Mode

SETTLE_S = 1.0
"""Longer than the limiter takes to reach any of these twists."""
SCENARIOS = {
    "straight": (0.5, 0.0, 0.0),
    "backwards": (-0.5, 0.0, 0.0),
    "strafe": (0.0, 0.4, 0.0),
    "diagonal": (0.3, -0.4, 0.0),
    "turn": (0.0, 0.0, 1.5),
    "circle": (0.5, 0.0, 1.0),
    "sideways circle": (0.0, 0.5, -1.0),
    "crawl": (0.01, 0.0, 0.0),
}


def moved(before: Array, after: Array) -> Array:
    """Displacement in the axes of the earlier pose."""
    c, s = np.cos(before[2]), np.sin(before[2])
    dx, dy, turn = after - before
    return np.array([c * dx + s * dy, -s * dx + c * dy, turn])


def arc(twist: tuple[float, float, float], seconds: float) -> Array:
    """Integrate a constant twist by small chords."""
    vx, vy, omega = twist
    times = (np.arange(20_000) + 0.5) * seconds / 20_000
    velocity = (vx + 1j * vy) * np.exp(1j * omega * times)
    where = velocity.mean() * seconds
    return np.array([where.real, where.imag, omega * seconds])


@pytest.mark.parametrize("twist", SCENARIOS.values(), ids=SCENARIOS)
def test_perfect_joints_drive_exactly_what_is_asked(
    rig: ControllerHarness, twist: tuple[float, float, float]
) -> None:
    pilot = rig.get_ready()
    rig.drive(pilot, twist, SETTLE_S)
    np.testing.assert_array_equal(rig.twist, twist)
    before = rig.pose
    rig.drive(pilot, twist, 2.0)
    # After arming, the modelled wheels are within a millionth of their speed.
    np.testing.assert_allclose(moved(before, rig.pose), arc(twist, 2.0), atol=1e-4)


@pytest.mark.parametrize("twist", SCENARIOS.values(), ids=SCENARIOS)
def test_a_simulated_robot_drives_what_is_asked_and_knows_where_it_is(
    sim_rig: ControllerHarness, twist: tuple[float, float, float]
) -> None:
    """Within one servo step, 16 mm/s at this wheel speed, and the turn rate of three steps."""
    pilot = sim_rig.get_ready()
    sim_rig.drive(pilot, twist, SETTLE_S)
    true_before, before = sim_rig.truth(), sim_rig.pose
    sim_rig.drive(pilot, twist, 2.0)
    true = moved(true_before, sim_rig.truth())
    np.testing.assert_allclose(true, arc(twist, 2.0), atol=0.5 * 0.016 * 2.0 / 0.15)
    np.testing.assert_allclose(sim_rig.controller.odometry(0).twist, twist, atol=0.5 * 0.016 / 0.15)
    np.testing.assert_allclose(moved(before, sim_rig.pose), true, atol=2e-3)


@pytest.mark.parametrize("heading", [0.0, 0.7, np.pi / 2, -3.0, 20.0])
def test_a_command_in_the_axes_of_the_world_is_obeyed_whatever_the_heading(
    rig: ControllerHarness, heading: float
) -> None:
    pilot = rig.get_ready()
    rig.place(1.0, 2.0, heading, pilot=pilot)
    rig.drive(pilot, (0.4, 0.3, 0.0), SETTLE_S, frame="odom")
    before = rig.pose
    rig.drive(pilot, (0.4, 0.3, 0.0), 1.0, frame="odom")
    np.testing.assert_allclose(rig.pose - before, [0.4, 0.3, 0.0], atol=1e-4)
    np.testing.assert_allclose(np.hypot(*rig.twist[:2]), 0.5)


def test_a_command_in_the_axes_of_the_world_goes_straight_while_turning(
    sim_rig: ControllerHarness,
) -> None:
    pilot = sim_rig.get_ready()
    sim_rig.drive(pilot, (0.5, 0.0, 2.0), SETTLE_S, frame="odom")
    track = []
    for _ in range(30):
        sim_rig.drive(pilot, (0.5, 0.0, 2.0), 0.1, frame="odom")
        track.append(sim_rig.truth())
    track = np.array(track)
    assert track[-1, 2] - track[0, 2] == pytest.approx(2.0 * 2.9, rel=0.05)
    assert track[-1, 0] - track[0, 0] == pytest.approx(0.5 * 2.9, rel=0.05)
    # Servos lag by 1/32 s, in which the robot turns by 0.06 rad, so the line is slightly tilted.
    slope = (track[-1, 1] - track[0, 1]) / (track[-1, 0] - track[0, 0])
    line = track[0, 1] + slope * (track[:, 0] - track[0, 0])
    assert abs(slope) < 2.0 * (1 / 32 + 0.02)
    np.testing.assert_allclose(track[:, 1], line, atol=0.02)


@pytest.mark.parametrize(
    "twist", [(3.0, 1.0, 0.0), (0.6, 0.0, 9.0), (1e9, -1e9, 0.0), (1e300, 1e300, 1e300)]
)
@pytest.mark.parametrize("frame", ["base_link", "odom"])
def test_a_saturated_command_keeps_its_direction_and_curvature(
    rig: ControllerHarness, twist: tuple[float, float, float], frame: str
) -> None:
    pilot = rig.get_ready()
    rig.drive(pilot, twist, 0.3)
    np.testing.assert_allclose(np.cross(rig.twist, np.divide(twist, max(twist))), 0.0, atol=1e-9)
    assert np.dot(rig.twist, np.divide(twist, max(twist))) > 0.0
    assert np.hypot(*rig.twist[:2]) <= 1.0 + 1e-9
    assert abs(rig.twist[2]) <= 3.0 + 1e-9
    rig.drive(pilot, twist, 1.0, frame)
    assert np.isfinite(rig.setpoint).all()


@pytest.mark.parametrize("heading", [0.0, 0.8, 2.4])
@pytest.mark.parametrize("size", [1e300, 1.7976931348623157e308])
def test_the_largest_numbers_there_are_do_no_harm(
    rig: ControllerHarness, size: float, heading: float
) -> None:
    """Rotated into robot axes, the sum of two components would overflow."""
    pilot = rig.get_ready()
    rig.place(0.0, 0.0, heading, pilot=pilot)
    rig.drive(pilot, (size, size, 0.0), 1.0, frame="odom")
    assert rig.mode is Mode.DRIVING
    along = np.pi / 4 - heading
    np.testing.assert_allclose(rig.twist, [np.cos(along), np.sin(along), 0.0], atol=1e-3)


def test_the_limits_say_what_they_let_through(rig: ControllerHarness) -> None:
    pilot = rig.get_ready()
    rig.drive(pilot, (0.5, 0.0, 0.0), 0.5)
    assert rig.status().limits.applied == 1.0
    assert "clamp" not in {event.kind for event in rig.controller.take_events()}
    rig.drive(pilot, (4.0, 0.0, 0.0), 2.0)
    clamps = [event for event in rig.controller.take_events() if event.kind == "clamp"]
    assert 3 <= len(clamps) <= 5
    assert clamps[-1].requested == [4.0, 0.0, 0.0]
    assert clamps[-1].applied == [1.0, 0.0, 0.0]
    assert clamps[-1].why is not None
    assert clamps[-1].why.params["percent"] == 25
    assert "speed" in clamps[-1].rule
    assert rig.status().limits.applied == 0.25


def test_a_lease_for_late_commands_drives_slower(rig: ControllerHarness) -> None:
    pilot = rig.get_ready(max_age_s=1.0)
    rig.drive(pilot, (1.0, 0.0, 0.0), 1.0)
    cap = rig.status().limits.speed_mps
    assert rig.status().limits.max_command_age_s == 1.0
    assert 0.2 < cap < 0.35
    np.testing.assert_allclose(rig.twist, [cap, 0.0, 0.0])
    assert rig.status().limits.turn_rate_rad_per_s == pytest.approx(3.0 * cap)


def test_components_that_no_planar_robot_has_move_nothing(rig: ControllerHarness) -> None:
    pilot = rig.get_ready()
    sample = rig.sample(pilot, (0, 0, 0))
    lifted = bytearray(sample.payload)
    lifted[-32:-24] = np.float64(1.0).tobytes()  # vz, fourth from the end.
    rig.inbox = [type(sample)(sample.key, bytes(lifted), sample.attachment)]
    rig.wait(0.1)
    assert rig.status().command.accepted > 0
    np.testing.assert_array_equal(rig.twist, 0.0)
