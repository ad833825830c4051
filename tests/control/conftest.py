"""Robots in virtual time."""

import pytest

from tests.support.controller_harness import ROBOT, ControllerHarness
from tsd_twin.simulation import SimRobot


@pytest.fixture
def rig() -> ControllerHarness:
    """A robot whose joints reach their setpoints at once."""
    return ControllerHarness()


@pytest.fixture
def sim_rig() -> ControllerHarness:
    """A robot with servo, motor and wheel models as described, without noise."""
    return ControllerHarness(SimRobot(ROBOT))
