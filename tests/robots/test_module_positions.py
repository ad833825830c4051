"""`[[drive.modules]]`: errors, derived figures, simulation, model, calibration and board."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest
from yourdfpy import URDF

from tests.support.controller_harness import PERIOD_S, ControllerHarness
from tests.support.robot_variants import CIRCLE, ODD, placed, text
from tsd_twin import robots
from tsd_twin.calibration.collect import with_calibration
from tsd_twin.calibration.report import edit_description
from tsd_twin.dashboard.sessions.student import solution_of
from tsd_twin.errors import RobotFileError
from tsd_twin.messages.modes import Mode
from tsd_twin.models import check_room, kinematic_tree, load_parts, write_model
from tsd_twin.robots import SingularityDescription
from tsd_twin.simulation import SimRobot, simulate

ROBOT = placed()
TSD = robots.description_of_kind(robots.load_robot("tsd"), SingularityDescription)
LAYOUTS = {
    "odd": ODD,
    "rectangle": ((0.3, 0.2), (0.3, -0.2), (-0.3, -0.2), (-0.3, 0.2)),
    "one in the centre": ((0.0, 0.0), (0.3, 0.0), (-0.1, 0.25)),
    "one behind another": ((0.15, 0.0), (0.35, 0.0), (-0.2, 0.1)),
}


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("[[drive.modules]]", f"{CIRCLE}[[drive.modules]]", "the pivots need azimuths_deg and"),
        ("x_m = 0.25\n", "", "key 'x_m' is missing in [drive.modules"),
        ("x_m = 0.25", "x = 0.25", "unknown key 'x' in [drive.modules"),
        ("x_m = 0.25", "x_m = 250.0", "drive.modules[0].x_m is 250 m, did you mean 0.25"),
        ("x_m = 0.25\ny_m = 0.15", "x_m = -0.2\ny_m = 0.12", "[1] are 0.02 m apart"),
    ],
)
def test_a_wrong_layout_names_its_key(old: str, new: str, problem: str) -> None:
    toml = text()
    assert toml.count(old) >= 1
    with pytest.raises(RobotFileError) as caught:
        robots.parse_description(toml.replace(old, new, 1), "my.toml")
    assert problem in str(caught.value)


def test_either_form_of_the_pivots_is_required() -> None:
    with pytest.raises(RobotFileError, match="azimuths_deg and pivot_radius_m, or modules"):
        robots.parse_description(robots.read_description("tsd").replace(CIRCLE, ""), "my.toml")


def test_values_survive_being_taken_apart_and_put_together() -> None:
    assert msgspec.convert(msgspec.to_builtins(ROBOT), SingularityDescription) == ROBOT


def test_short_form_and_positions_on_its_circle_describe_one_robot() -> None:
    points = [(float(x), float(y)) for x, y in TSD.drive.pivots_m]
    same = placed(points)
    assert same.drive.rms_radius_m == pytest.approx(TSD.drive.pivot_radius_m)
    assert same.turning_inertia_kg_m2 == pytest.approx(TSD.turning_inertia_kg_m2)
    assert same.floor_turn_rad_per_s == pytest.approx(TSD.floor_turn_rad_per_s)
    ours, theirs = same.joint_compliance(), TSD.joint_compliance()
    assert ours is not None
    assert theirs is not None
    np.testing.assert_allclose(ours.by_acceleration, theirs.by_acceleration, atol=1e-15)
    shown, expected = (solution_of(each, np.array([0.3, 0.2, 1.0]))[1] for each in (same, TSD))
    assert [one.value for one in shown.figures] == pytest.approx(
        [one.value for one in expected.figures]
    )
    for ours, theirs in zip(shown.wheels, expected.wheels, strict=True):
        assert ours.at == pytest.approx(theirs.at)
        assert ours.push == pytest.approx(theirs.push)


@pytest.mark.parametrize("plant", ["kinematic", "mujoco"])
def test_the_simulated_robot_follows_a_twist(plant: str) -> None:
    drive = ROBOT.kinematics()
    simulation = simulate(ROBOT, plant=plant)
    neutral = drive.inverse(np.zeros(3))
    neutral[2::3] = 0.0
    for joints, time_s in ((neutral, 2.5), (drive.inverse(np.zeros(3)), 1.5)):
        simulation.command(joints)
        simulation.advance(time_s)
    twist = np.array([0.3, 0.2, 0.8])
    simulation.command(drive.inverse(twist))
    simulation.advance(0.8)
    np.testing.assert_allclose(simulation.twist(), twist, rtol=0.08)


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (-0.6, 0.6, 0.0)])
def test_it_stops_within_its_allowance_when_the_link_is_lost(
    direction: tuple[float, float, float],
) -> None:
    rig = ControllerHarness(SimRobot(ROBOT), robot=ROBOT)
    pilot = rig.get_ready()
    speed = 2.0 * rig.status().limits.speed_mps
    for _ in range(round(1.5 / PERIOD_S)):
        rig.inbox.append(rig.sample(pilot, tuple(speed * part for part in direction)))
        rig.tick()
    simulated = rig.simulated
    assert simulated is not None
    start = simulated.truth(rig.now_s).pose
    for _ in range(round(2.0 / PERIOD_S)):
        rig.tick()
    assert rig.mode is Mode.READY
    travel = (start.inverse() @ simulated.truth(rig.now_s).pose).xy_heading[:2]
    assert 0.1 < np.hypot(*travel) <= ROBOT.limits.stop_allowance_m


@pytest.mark.parametrize("points", LAYOUTS.values(), ids=LAYOUTS)
def test_every_layout_has_a_model_with_its_pivots(
    points: tuple[tuple[float, float], ...], tmp_path: Path
) -> None:
    robot = placed(points)
    check_room(robot)
    parts = load_parts(robot)  # An open solid would raise an error here.
    assert set(parts) == {"chassis", "outer", "inner", "wheel"}
    low = min(float(part.mesh.bounds[0][2]) for part in parts["wheel"])
    assert low == pytest.approx(-robot.drive.wheel_radius_m, abs=1e-3)
    write_model(robot, tmp_path)
    (file,) = tmp_path.glob("*.urdf")
    urdf = URDF.load(str(file), load_meshes=False)
    for i, (x, y) in enumerate(points):
        pose = urdf.get_transform(f"module{i + 1}_wheel", "base_link")
        np.testing.assert_allclose(pose[:2, 3], [x, y], atol=1e-6)
    assert kinematic_tree(robot).link_group("outer").count == len(points)


def test_a_calibrated_radius_moves_all_pivots_by_one_factor() -> None:
    radius_m = 1.02 * ROBOT.drive.rms_radius_m
    found = with_calibration(ROBOT, np.zeros((3, 2)), np.ones(3), 0.041, radius_m)
    np.testing.assert_allclose(found.drive.pivots_m, 1.02 * ROBOT.drive.pivots_m)
    assert found.drive.wheel_radius_m == 0.041


def test_calibrated_positions_are_written_into_the_file() -> None:
    modules = [{"x_m": 0.26, "y_m": 0.16}, {"x_m": -0.21, "y_m": 0.11}, {"x_m": 0.0, "y_m": -0.2}]
    edited = edit_description(text(), "my.toml", {"drive": {"modules": modules}})
    robot = robots.description_of_kind(
        robots.parse_description(edited, "my.toml"), SingularityDescription
    )
    assert msgspec.to_builtins(robot)["drive"]["modules"] == modules
    assert robot.limits == ROBOT.limits
