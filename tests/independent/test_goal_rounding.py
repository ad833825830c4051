"""Joint rounding of gimbal goals on wheels that grip, slide and push their gimbals aside."""

from __future__ import annotations

import numpy as np
import pytest

from tests.independent.built import Undeclared
from tests.independent.singularity import SingularityPlant
from tsd_twin import robots
from tsd_twin.control.goal_rounding import GoalRounding
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityDescription, description_of_kind

TSD = description_of_kind(robots.load_robot("tsd"), SingularityDescription)
PERIOD_S = 0.01


def turn_rate(twist: tuple[float, float, float], rounding: GoalRounding | None) -> float:
    """Drive for 3 s without errors; return the mean turn rate after the first second, rad/s.

    Without `rounding`, each servo rounds its own goal.
    """
    plant = SingularityPlant(TSD, 1, 9400, errors=0.0, noise=0.0, undeclared=Undeclared())
    drive, heading = TSD.kinematics(), 0.0
    joints: Array = drive.inverse(np.zeros(3))
    plant.command(joints)
    plant.advance(1.0)
    joints = drive.inverse(np.array(twist))
    for i in range(300):
        goals = joints if rounding is None else rounding.step(joints, PERIOD_S)
        plant.command(goals)
        plant.advance(PERIOD_S)
        if i == 99:
            heading = plant.pose[0, 2]
    return float(plant.pose[0, 2] - heading) / 2.0


def test_rounded_alone_a_robot_turns() -> None:
    """Straight ahead at 0.5 m/s."""
    assert turn_rate((0.5, 0.0, 0.0), None) > 0.03


@pytest.mark.parametrize(
    "twist",
    [(0.2, 0.0, 0.0), (0.5, 0.0, 0.0), (1.0, 0.0, 0.0), (0.35, 0.35, 0.0), (-0.1, 0.4, 0.0)],
)
def test_rounded_together_a_robot_drives_straight(twist: tuple[float, float, float]) -> None:
    """The floor turns it by 3 mrad/s (`floor_turn_rad_per_s`), as at rest."""
    drag = TSD.floor_turn_rad_per_s
    assert abs(turn_rate(twist, GoalRounding(TSD))) < drag + 4e-3
