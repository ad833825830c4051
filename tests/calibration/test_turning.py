"""Wheel speed from turns on the spot, against the simulator's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.experiment_runs import is_picture, run, table
from tests.support.robot_node import PATIENT, running
from tsd_twin import RobotState, SimulatedRobot, connect, robots
from tsd_twin.calibration.turning import SpinResult, measure_turns, sensor_sigma_of
from tsd_twin.errors import TwinError
from tsd_twin.robots import SingularityDescription, description_of_kind
from tsd_twin.simulation import SimRobot

TURNS = 6


class _Camera:
    """Publishes noisy poses of a robot."""

    def __init__(self, robot: SimulatedRobot, seed: int) -> None:
        self._robot, self._random = robot, np.random.default_rng(seed)

    def watch(self, state: RobotState) -> None:
        assert state.truth is not None
        noise = np.array([0.005, 0.005, 0.02]) * self._random.standard_normal(3)
        x_m, y_m, heading_rad = np.array(state.truth.pose) + noise
        self._robot.publish_pose(x_m, y_m, heading_rad)


@pytest.fixture
def described(tmp_path: Path) -> dict[str, str]:
    with_gyro = tmp_path / "tsd_gyro.toml"
    with_gyro.write_text(robots.read_description("tsd") + "\n[gyro]\n")
    return {"gyro": str(with_gyro), "camera": "tsd", "": "tsd"}


def learned(name: str, sensor: str, seed: int) -> tuple[SpinResult, float]:
    """Return the result, and the true mean wheel speed relative to its setpoint."""
    simulated = SimulatedRobot(name, seed=seed, noise=1.0, errors=1.0)
    robot = description_of_kind(robots.load_robot(name), SingularityDescription)
    with simulated, simulated.control("lab") as control:
        if sensor == "camera":
            simulated.on_state(_Camera(simulated, seed).watch)
            simulated.sleep(0.5)
        client: Any = simulated
        held: Any = control
        shares = np.array(list(measure_turns(client, held, robot, TURNS)))
        found = SpinResult(shares, sensor_sigma_of(robot, simulated.state.status))
        truth = client.link.simulated.truth(simulated.time_s).joints[2::3]
    return found, float(truth.mean() / robot.kinematics().spin_rad_per_s)


@pytest.mark.parametrize("sensor", ["gyro", "camera"])
def test_turns_find_the_wheel_speed_within_its_sigma(
    described: dict[str, str], sensor: str
) -> None:
    found = [learned(described[sensor], sensor, seed) for seed in range(40, 43)]
    z = np.array([(each.share - true) / each.sigma for each, true in found])
    assert np.abs(z).max() < 4.0
    assert np.sqrt(np.mean(np.square(z))) < 2.0
    off = np.array([each.share - true for each, true in found])
    before = np.array([true - 1.0 for _, true in found])
    assert np.abs(off).max() < 0.012
    assert np.sqrt(np.mean(off**2)) < 0.4 * np.sqrt(np.mean(before**2))


def test_robot_without_sensor_is_refused(described: dict[str, str]) -> None:
    with pytest.raises(TwinError, match="gyro"):
        learned(described[""], "", 1)


def test_key_ends_the_turns(described: dict[str, str]) -> None:
    simulated = SimulatedRobot(described["gyro"])
    robot = description_of_kind(simulated.link.robot, SingularityDescription)
    with simulated, simulated.control("lab") as control:
        client: Any = simulated
        held: Any = control
        pressed = iter([False] * 20)
        with pytest.raises(TwinError, match="key"):
            list(measure_turns(client, held, robot, 4, lambda: next(pressed, True)))
        simulated.sleep(1.0)
        assert simulated.state.mode == "ready"
        assert abs(simulated.state.odom.twist.omega_rad_per_s) < 0.01


def test_sigma_combines_scatter_and_sensor() -> None:
    shares = np.array([1.02, 1.04, 1.03, 1.03])
    assert SpinResult(shares, 0.0).sigma == pytest.approx(shares.std(ddof=1) / 2.0)
    assert SpinResult(shares, 0.004).sigma > 0.004
    assert SpinResult(shares, 0.004).share == pytest.approx(1.03)


@pytest.mark.timed
def test_robot_on_the_bus_turns_and_its_wheel_speed_is_written(tmp_path: Path) -> None:
    text = PATIENT + "\n[gyro]\n"
    mine = tmp_path / "mine.toml"
    simulated = SimRobot(robots.parse_description(text, "mine"), 3, battery_v=11.4)
    with running(toml=text, io=simulated) as node:
        flags = ["--connect", node.endpoint, "--yes", "--turns", "2"]
        lines = run(tmp_path, "turn", *flags, "--write-to", str(mine))
        with connect(node.endpoint) as robot, robot.control(arm=False):
            assert robot.state.mode == "disarmed"
    assert "2 turns of 143 deg, measured by a gyro" in lines[0]
    assert is_picture(tmp_path / "turn.png")
    assert len(table(tmp_path / "turn.csv")["share"]) == 2
    written = robots.parse_description(mine.read_text(), "mine")
    calibrated = description_of_kind(written, SingularityDescription)
    assert f"[errors] motor_share = {calibrated.errors.motor_share}" in lines
    assert 0.004 <= calibrated.errors.motor_share < 0.02
    scale = calibrated.calibration.spin_scale
    assert scale == pytest.approx([11.4 / 12.0] * 3, abs=0.02)


@pytest.mark.timed
def test_robot_on_the_bus_without_gyro_is_not_armed(tmp_path: Path) -> None:
    with running() as node:
        with pytest.raises(TwinError, match="gyro"):
            run(tmp_path, "turn", "--connect", node.endpoint, "--yes")
        with connect(node.endpoint) as robot:
            assert robot.state.mode == "disarmed"
