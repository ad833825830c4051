"""What the wheels of a virtual robot say of its motion."""

from __future__ import annotations

from tsd_twin.estimation import Slip
from tsd_twin.lab.virtual_robot import PERIOD_S, VirtualRobot
from tsd_twin.lie import Array


def rolled(robot: VirtualRobot, slip: Slip | None) -> Array:
    """Return the twist (3,) by the wheels, over the floor that `slip` knows, one period on."""
    twist = robot.spin_share * robot.odometry().twist
    return twist if slip is None else slip.advance(twist / slip.rest_share, PERIOD_S)
