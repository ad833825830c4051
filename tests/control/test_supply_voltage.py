"""The reported battery voltage scales the modelled speed of wheels without encoders."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from tests.support.controller_harness import ROBOT, ControllerHarness
from tsd_twin.lie import SE2
from tsd_twin.robots import SingularityDescription, description_of_kind
from tsd_twin.simulation import SimRobot

TSD = description_of_kind(ROBOT, SingularityDescription)
ROLLING = msgspec.structs.replace(TSD, floor=msgspec.structs.replace(TSD.floor, friction=0.0))
"""Floor without slip and drag, like the kinematic plant."""
CALIBRATED = msgspec.structs.replace(
    ROLLING, errors=msgspec.structs.replace(ROLLING.errors, motor_share=0.0)
)
"""Also an exact motor table, whose error no voltage explains."""


def reported(volts: float) -> float:
    return round(volts * 10.0) / 10.0


def driven(
    seed: int,
    *,
    reports: bool,
    errors: float = 1.0,
    battery_v: float | None = None,
    robot: SingularityDescription = ROLLING,
) -> ControllerHarness:
    """Return a robot after 3 s of forward driving with a slow turn, at its true battery voltage."""
    simulated = SimRobot(robot, seed, errors, errors=errors, battery_v=battery_v)
    rig = ControllerHarness(simulated, robot=robot)
    true_v = simulated.hardware()["battery_v"]
    assert isinstance(true_v, float)
    rig.battery_v = reported(true_v) if reports else None
    rig.tick()
    pilot = rig.get_ready()
    rig.drive(pilot, [0.5, 0.2, 0.3], 3.0)
    return rig


def nees(rig: ControllerHarness) -> float:
    message, truth = rig.controller.odometry(0), SE2(rig.truth())
    off = (truth.inverse() @ SE2(message.xy_heading)).xy_heading
    off[:2] = truth.rotate(off[:2])
    return float(off @ np.linalg.solve(message.pose_covariance, off))


def test_reported_voltage_corrects_the_distance() -> None:
    off_m: dict[bool, float] = {}
    for reports in (False, True):
        rig = driven(0, reports=reports, errors=0.0, battery_v=11.4)
        off_m[reports] = math.dist(rig.pose[:2], rig.truth()[:2])
    assert off_m[False] > 0.04
    assert off_m[True] < 0.25 * off_m[False]


def test_robot_at_low_voltage_still_gets_ready() -> None:
    rig = driven(0, reports=True, errors=0.0, battery_v=10.8)
    assert np.linalg.norm(rig.truth()[:2]) > 0.3


@pytest.mark.parametrize("reports", [False, True])
def test_covariance_matches_the_error_with_and_without_reports(reports: bool) -> None:
    found = [nees(driven(seed, reports=reports)) for seed in range(60, 90)]
    assert 1.5 < np.mean(found) < 6.0


def deviation(robot: SingularityDescription, *, reports: bool) -> float:
    odometry = driven(1, reports=reports, robot=robot).controller.odometry(0)
    return math.sqrt(np.trace(odometry.pose_covariance[:2, :2]))


def test_reports_make_the_covariance_smaller() -> None:
    alone, reported = (deviation(CALIBRATED, reports=each) for each in (False, True))
    assert reported < 0.8 * alone


def test_motor_table_error_remains_with_reports() -> None:
    """It is 4 % of the distance, at 0.54 m/s for 3 s."""
    exact, assumed = (deviation(each, reports=True) for each in (CALIBRATED, ROLLING))
    assert math.sqrt(assumed**2 - exact**2) == pytest.approx(0.04 * 0.54 * 3.0, rel=0.2)


@pytest.mark.parametrize("battery_v", [0.0, math.nan, 60.0, -12.0])
def test_implausible_voltage_changes_nothing(battery_v: float) -> None:
    rigs = [ControllerHarness(SimRobot(ROBOT)) for _ in range(2)]
    for rig, volts in zip(rigs, (None, battery_v), strict=True):
        pilot = rig.get_ready()
        rig.battery_v = volts
        rig.send(pilot, [0.2, 0.0, 0.0])
        rig.tick()
        assert np.isfinite(rig.controller.joints).all()
    np.testing.assert_array_equal(rigs[0].controller.joints, rigs[1].controller.joints)
