"""Robots in virtual time."""

import pytest

from tests.core.rig import ROBOT, Rig
from tsd_twin.sim import SimRobot


@pytest.fixture
def rig() -> Rig:
    """A robot whose joints do at once what they are told."""
    return Rig()


@pytest.fixture
def sim_rig() -> Rig:
    """A robot with servos, motors and wheels as described, without noise."""
    return Rig(SimRobot(ROBOT))
