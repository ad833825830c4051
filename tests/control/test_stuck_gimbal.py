"""A gimbal that jams during driving is named in the status within 0.2 s."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.controller_harness import ROBOT, ControllerHarness
from tsd_twin.messages.codes import Code, because
from tsd_twin.simulation import DegradedRobot, SimRobot, StuckJoint

STATUS_S = 0.05
"""Status period, which adds to the detection time."""


@pytest.mark.parametrize("gimbal", [0, 1], ids=["alpha", "beta"])
@pytest.mark.parametrize("module", [1, 2, 3])
@pytest.mark.parametrize("before_mps", [-0.8, 0.0])
def test_one_jammed_gimbal_is_named_within_a_fifth_of_a_second(
    before_mps: float, module: int, gimbal: int
) -> None:
    """Measured from when the gimbal would have to move; before that, the jam has no effect."""
    azimuth = np.radians([90.0, 210.0, 330.0][module - 1]) - (np.pi / 2 if gimbal == 0 else 0.0)
    way = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    before, after = before_mps * way, 0.8 * way
    simulated = DegradedRobot(ROBOT, seed=5, noise=1.0)
    rig = ControllerHarness(simulated)
    pilot = rig.get_ready()
    rig.drive(pilot, before, 1.0)
    assert rig.status().consistency.suspect is None
    simulated.jam(StuckJoint(f"module{module}_{('alpha', 'beta')[gimbal]}"))
    rig.drive(pilot, after, 0.2 - STATUS_S)
    consistency = rig.status().consistency
    assert consistency.suspect == f"module{module}"
    assert consistency.level > 1.0
    assert set(consistency.contributions) == {"module1", "module2", "module3"}
    (event,) = [event for event in rig.controller.take_events() if event.kind == "consistency"]
    assert event.why == because(Code.ACTUATOR_SUSPECT, actuator=f"module{module}")


def test_what_is_not_believed_makes_the_pose_less_certain() -> None:
    spreads = []
    for off in (0.0, 0.05):
        rig = ControllerHarness(SimRobot(ROBOT))
        pilot = rig.get_ready()
        assert rig.simulated is not None
        read = rig.simulated.read
        rig.simulated.read = lambda now_s, read=read, off=off: read(now_s) + off * np.eye(9)[3]  # type: ignore[method-assign]
        rig.drive(pilot, (0.5, 0.0, 0.0), 1.0)
        spreads.append(np.sqrt(np.trace(rig.controller.odometry(0).pose_covariance[:2, :2])))
    assert spreads[1] > 5.0 * spreads[0]
