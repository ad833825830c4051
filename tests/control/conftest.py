"""Robots in virtual time."""

import pytest

from tests.support.controller_harness import ROBOT, ControllerHarness
from tsd_twin.simulation import SimRobot


@pytest.fixture
def rig() -> ControllerHarness:
    """A robot whose joints do at once what they are told."""
    return ControllerHarness()


@pytest.fixture
def sim_rig() -> ControllerHarness:
    """A robot with servos, motors and wheels as described, without noise."""
    return ControllerHarness(SimRobot(ROBOT))
