"""Zeroing: measure the creep, attribute it to gimbals and correct it, numerically and on a bus."""

from __future__ import annotations

import io
import math
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.experiment_runs import is_picture, run, table
from tests.support.robot_node import PATIENT, RunningNode, matched, running
from tests.support.withheld import PATIENCE_S, WithheldTime
from tsd_mock import OverheadCamera
from tsd_twin import connect, robots
from tsd_twin.calibration.collect import with_calibration
from tsd_twin.calibration.operator import ask_displacement, hold_control
from tsd_twin.calibration.zeroing import (
    PoseTracker,
    ZeroOffsetDrift,
    corrective_steps,
    drift_by_hand,
    drift_of,
    twist_by_zero_offsets,
)
from tsd_twin.client import RobotClient
from tsd_twin.client.bus_port import BusLink
from tsd_twin.client.connection import RobotConnection
from tsd_twin.errors import TwinError
from tsd_twin.lie import SE2
from tsd_twin.messages import topics
from tsd_twin.messages.pose import PoseStamped, encode_pose
from tsd_twin.messages.topics import QoS
from tsd_twin.robots import SingularityDescription
from tsd_twin.simulation import SimRobot, simulate

ROBOT = robots.description_of_kind(
    robots.parse_description(PATIENT, "quick"), SingularityDescription
)
STEP_RAD = 2 * np.pi / 4096
TWISTS = st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(-0.7, 0.7)).map(np.array)
ZEROS = st.lists(st.floats(-0.6, 0.6), min_size=6, max_size=6).map(np.array)


def off_by(zeros_deg: np.ndarray) -> SingularityDescription:
    """A machine whose gimbals have these angles when commanded upright."""
    drive = ROBOT.drive
    return with_calibration(
        ROBOT, zeros_deg.reshape(3, 2), np.ones(3), drive.wheel_radius_m, drive.pivot_radius_m
    )


@given(TWISTS, st.floats(1.0, 30.0))
def test_a_constant_twist_is_told_from_poses_and_by_hand(twist: np.ndarray, seconds: float) -> None:
    t_s = np.linspace(0.0, seconds, 50)
    start = SE2(np.array([3.0, -2.0, 2.5]))
    poses = (start @ SE2.exp(twist * t_s[:, None])).xy_heading
    poses[:, 2] = (poses[:, 2] + np.pi) % (2 * np.pi) - np.pi  # The bus wraps headings.
    np.testing.assert_allclose(drift_of(t_s + 7.0, poses, 2500.0).twist, twist, atol=1e-6)
    end = SE2.exp(twist * seconds).xy_heading
    if abs(end[2]) < 6.0:  # A whole turn returns to the start, so no drift is visible.
        by_hand = drift_by_hand(end[:2], end[2], seconds, 2500.0)
        np.testing.assert_allclose(by_hand.twist, twist, atol=1e-9)


def test_the_criterion_is_an_inch_in_thirty_seconds_at_2500_rpm() -> None:
    inch = ZeroOffsetDrift(np.array([0.0254 / 30.0, 0.0, 0.0]), 2500.0)
    assert inch.distance_m == pytest.approx(0.0254)
    assert not ZeroOffsetDrift(1.01 * inch.twist, 2500.0).passes
    assert ZeroOffsetDrift(0.99 * inch.twist, 2500.0).passes
    # Twice the speed doubles the creep for the same zeros.
    assert ZeroOffsetDrift(1.9 * inch.twist, 5000.0).passes


@settings(max_examples=20)
@given(ZEROS)
def test_creep_by_zeros_is_that_of_the_simulator(zeros_deg: np.ndarray) -> None:
    true = off_by(zeros_deg)
    simulation = simulate(true)
    upright = true.kinematics().inverse(np.zeros(3)).reshape(3, 3)
    upright[:, :2] = np.radians(zeros_deg).reshape(3, 2)  # Servos commanded to zero.
    still = upright.copy()
    still[:, 2] = 0.0
    for setpoint, seconds in ((still, 2.0), (upright, 20.0)):
        simulation.command(setpoint.ravel())
        simulation.advance(seconds)
    expected = twist_by_zero_offsets(ROBOT) @ np.radians(zeros_deg)
    np.testing.assert_allclose(simulation.twist(), expected, atol=1e-4)


@settings(max_examples=6)
@given(ZEROS)
def test_whole_steps_of_the_servos_suffice_for_the_criterion(zeros_deg: np.ndarray) -> None:
    creep = ZeroOffsetDrift(twist_by_zero_offsets(ROBOT) @ np.radians(zeros_deg), 2500.0)
    steps, left = corrective_steps(ROBOT, creep)
    np.testing.assert_array_equal(steps, np.rint(steps))
    assert left.passes
    np.testing.assert_allclose(
        left.twist,
        twist_by_zero_offsets(ROBOT) @ (np.radians(zeros_deg) - steps * STEP_RAD),
        atol=1e-12,
    )
    # One alpha step turns the robot by 2 °/s, so rounding leaves up to half of that.
    assert abs(math.degrees(left.turn_rad)) < 32.0


@pytest.mark.timed
def test_a_robot_on_the_bus_creeps_is_put_right_and_stands(tmp_path: Path) -> None:
    true = off_by(np.array([0.5, -0.3, 0.2, 0.6, -0.4, 0.1]))
    mine = tmp_path / "mine.toml"

    def zero(toml: str, *flags: str) -> list[str]:
        believed = robots.description_of_kind(
            robots.parse_description(toml, "mine"), SingularityDescription
        )
        with running(toml=toml, io=SimRobot(true, believed=believed)) as node:
            lines = run(
                tmp_path, "zero", "--connect", node.endpoint, "--seconds", "3", "--yes", *flags
            )
            with connect(node.endpoint) as robot, robot.control(arm=False):
                pass  # Control is free again.
            return lines

    first = zero(PATIENT, "--write-to", str(mine))
    assert "FAIL" in first[1]
    assert any(line.startswith("written into") for line in first)
    assert is_picture(tmp_path / "zero.png")
    creep = drift_of(*_seen(tmp_path), 2500.0)
    expected = twist_by_zero_offsets(ROBOT) @ np.radians([0.5, -0.3, 0.2, 0.6, -0.4, 0.1])
    np.testing.assert_allclose(creep.twist, expected, atol=2e-3)
    again = zero(mine.read_text("utf-8"))
    assert "PASS" in again[1]
    assert len(again) == 2


@pytest.mark.timed
def test_a_camera_on_the_bus_is_asked_before_the_ruler_and_the_simulator(tmp_path: Path) -> None:
    zeros_deg = np.array([0.5, -0.3, 0.2, 0.6, -0.4, 0.1])
    io = SimRobot(off_by(zeros_deg), believed=ROBOT)
    with (
        running(io=io) as node,
        node.client() as bus,
        OverheadCamera(bus, node.id),
        WithheldTime() as withheld,
    ):
        lines = run(tmp_path, "zero", "--connect", node.endpoint, "--seconds", "2", "--yes")
    assert "seen by a camera" in lines[0]
    t_s, poses = _seen(tmp_path)
    assert 30 - 24.0 * withheld.total_s < len(t_s) < 60  # Frame rate 24 fps.
    found = drift_of(t_s, poses, 2500.0)
    assert 0.0 < found.sigma_mps < 0.01
    off = found.twist - twist_by_zero_offsets(ROBOT) @ np.radians(zeros_deg)
    assert np.hypot(*off[:2]) < 6.0 * found.sigma_mps


@pytest.mark.timed
def test_a_camera_that_says_no_numbers_is_not_believed_and_the_reason_kept() -> None:
    with running() as node, node.client() as bus:
        sight = PoseTracker(RobotConnection(bus, node.id))
        poses = matched(bus.publisher(topics.SENSOR_POSE.key(node.id), QoS.DATA))
        bad = encode_pose(PoseStamped.planar(SE2(np.array([np.nan, 0.0, 0.0])), 0))
        end_s = time.monotonic() + PATIENCE_S
        while not (sight.refused and len(sight.poses) > 1):
            assert time.monotonic() < end_s
            poses.put(bad)
            time.sleep(0.02)
            sight.poll()
    assert "nonfinite" in sight.refused
    assert sight.source_name == "the simulator"


def test_noise_of_a_camera_shows_in_how_well_creep_is_known() -> None:
    random, t_s = np.random.default_rng(0), np.arange(0.0, 3.0, 1.0 / 24.0)
    twist = np.array([0.01, -0.005, 0.02])
    exact = SE2.exp(twist * t_s[:, None]).xy_heading
    found = []
    for _ in range(200):
        noise = np.array([0.005, 0.005, 0.0]) * random.standard_normal(exact.shape)
        found.append(drift_of(t_s, exact + noise, 2500.0))
    spread = np.std([creep.twist[0] for creep in found])
    assert np.mean([creep.sigma_mps for creep in found]) == pytest.approx(spread, rel=0.25)


def _seen(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    columns = table(folder / "zero.csv")
    poses = np.column_stack([columns[name] for name in ("x_m", "y_m", "heading_rad")])
    return columns["t_s"], poses


@pytest.mark.timed
def test_no_wheel_turns_when_another_has_control(tmp_path: Path) -> None:
    with running() as node, connect(node.endpoint) as other, other.control("alice", arm=False):
        with pytest.raises(TwinError, match="gives no control: alice"):
            run(tmp_path, "zero", "--connect", node.endpoint, "--yes")
        assert other.state.mode == "disarmed"


def calibrating(node: RunningNode) -> RobotClient:
    """Connect to a node's robot as a calibration does."""
    return RobotClient(BusLink(node.client(), node.id), "lab")


@pytest.mark.timed
def test_who_loses_control_is_told_and_leaves_the_robot_to_the_other() -> None:
    with running() as node, calibrating(node) as lab, connect(node.endpoint) as other:
        alice = other.control("alice", take_over=True, arm=False)
        with hold_control(lab, "lab") as control:
            list(control.arming())
            held = control.staying_ready(60.0)
            next(held)
            alice.acquire()
            with pytest.raises(TwinError, match="alice has control"):
                list(held)
        assert (other.state.mode, other.state.lease.holder) == ("ready", "alice")


@pytest.mark.timed
def test_a_robot_that_falls_silent_is_not_waited_for() -> None:
    with running() as node, calibrating(node) as lab:

        def hold() -> None:
            with hold_control(lab, "lab") as control:
                list(control.arming())
                node.stopping.set()
                with pytest.raises(TwinError, match=r"has sent no status|is stopped"):
                    list(control.staying_ready(60.0))

        with pytest.raises(TwinError, match="could not be disarmed"):
            hold()


def test_numbers_are_asked_for_until_they_are_some(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("far\nnan\n-12.5\n3\n-90\n"))
    moved_m, turned_rad = ask_displacement()
    np.testing.assert_allclose(moved_m, [-0.0125, 0.003])
    assert turned_rad == pytest.approx(-math.pi / 2)


def test_nobody_at_the_keyboard_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    with pytest.raises(TwinError, match="operator at the keyboard"):
        ask_displacement()


@pytest.mark.parametrize("seconds", ["0", "nan", "1e9"])
def test_an_impossible_time_is_refused(tmp_path: Path, seconds: str) -> None:
    with pytest.raises(TwinError, match=r"--seconds: .* from 1 to 300"):
        run(tmp_path, "zero", "--seconds", seconds)
