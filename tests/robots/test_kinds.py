"""The registry of kinds names implementations that exist and fit."""

from __future__ import annotations

import numpy as np
import pytest

from tsd_twin import robots
from tsd_twin.kinematics import Kinematics
from tsd_twin.robots import KINDS, RobotKind, implementation, kind_of, load_robot, robot_names
from tsd_twin.simulation import simulate

SHIPPED = [load_robot(name) for name in robot_names()]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_every_reference_of_a_kind_can_be_imported(kind: RobotKind) -> None:
    others = kind.sensor_odometry, kind.telemetry, kind.student_wheels
    for reference in (*kind.simulations.values(), *others):
        assert callable(implementation(reference)), reference
    model = implementation(kind.model)
    assert all(callable(getattr(model, name)) for name in ("draw", "tree", "masses_kg"))


def test_names_of_kinds_and_their_descriptions_differ() -> None:
    assert len({kind.name for kind in KINDS}) == len(KINDS)
    assert len({kind.description for kind in KINDS}) == len(KINDS)


def test_every_kind_is_shipped_and_every_shipped_robot_has_a_kind() -> None:
    simulated = {kind.name for kind in KINDS if kind.simulations}
    assert {kind_of(robot).name for robot in SHIPPED} == simulated
    assert {kind.name for kind in KINDS} - simulated == {"imported"}


@pytest.mark.parametrize("robot", SHIPPED, ids=lambda robot: robot.name)
def test_what_a_kind_brings_fits_together(robot: robots.RobotDescription) -> None:
    kinematics: Kinematics[object] = robot.kinematics()  # pyright: ignore[reportInvalidTypeArguments]
    simulation = simulate(robot)
    joints = len(kinematics.joints)
    assert simulation.kinematics.joints == kinematics.joints
    assert simulation.measure().shape == (joints + len(robot.sensors),)
    tree = implementation(kind_of(robot).model).tree(robot)
    assert isinstance(tree.height_m, float)
    assert np.all(np.isfinite(kinematics.inverse(np.zeros(3))))
