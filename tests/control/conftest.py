"""Robots in virtual time."""

import pytest

from tests.support.controller_harness import ROBOT, ControllerHarness, with_exact_setpoints
from tsd_twin.simulation import SimRobot


@pytest.fixture
def rig() -> ControllerHarness:
    """A robot whose joints reach their setpoints at once, and have no steps."""
    return ControllerHarness(robot=with_exact_setpoints(ROBOT))


@pytest.fixture
def sim_rig() -> ControllerHarness:
    """A robot with servo, motor and wheel models as described, without noise."""
    return ControllerHarness(SimRobot(ROBOT))
