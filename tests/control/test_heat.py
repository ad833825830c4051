"""Hot servos limit the speed for every operator and command."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.control.test_battery import arm_again
from tests.support.controller_harness import ROBOT, ControllerHarness
from tsd_twin.control.monitors import HOT_MARGIN_C, WARM_MARGIN_C, HeatMonitor
from tsd_twin.messages.codes import Code, because
from tsd_twin.simulation import SimRobot

LOW_MPS = ROBOT.battery.low_speed_share * ROBOT.limits.speed_mps


@pytest.mark.parametrize("limit_c", [80.0, 72.0, 70.0])
def test_it_is_slow_from_hot_until_disarmed_and_cool(limit_c: float) -> None:
    random = np.random.default_rng(2)
    warm_c, hot_c = limit_c - WARM_MARGIN_C, limit_c - HOT_MARGIN_C
    monitor, slow, events = HeatMonitor(0.5, limit_c), False, 0
    for i in range(3000):
        celsius = [
            None,
            math.nan,
            random.uniform(40.0, 80.0),
            random.uniform(warm_c - 1.0, hot_c + 1.0),
        ][random.integers(4)]
        armed = bool(random.integers(3))
        events += monitor.step(celsius, 0.01 * i, armed=armed) is not None
        if celsius is not None and celsius >= hot_c:
            slow = True
        elif celsius is not None and celsius < warm_c and not armed:
            slow = False
        assert monitor.share == (0.5 if slow else 1.0)
        assert (monitor.why is not None) == slow
    assert events > 100


def test_a_warm_servo_is_said_once_and_changes_nothing() -> None:
    monitor = HeatMonitor(0.5, 80.0)
    event = monitor.step(65.0, 0.0, armed=True)
    assert event is not None
    assert event.why == because(Code.SERVO_WARM, celsius=65, limit_c=70)
    assert monitor.step(69.9, 0.1, armed=True) is None
    assert monitor.share == 1.0


def test_at_full_speed_it_slows_down_and_stays_slow_until_it_was_disarmed() -> None:
    rig = ControllerHarness(SimRobot(ROBOT))
    rig.servo_c = 60.0
    pilot = rig.get_ready()
    rig.drive(pilot, (1.0, 0.0, 0.0), 1.5)
    assert rig.twist[0] == pytest.approx(1.0)
    rig.controller.take_events()
    rig.servo_c = 70.0
    rig.drive(pilot, (1.0, 0.0, 0.0), 1.5)
    assert rig.twist[0] == pytest.approx(LOW_MPS)
    (event,) = [event for event in rig.controller.take_events() if event.kind == "heat"]
    hot = because(Code.SERVO_HOT, limit_c=70)
    assert event.why == because(Code.SLOWED, hot, percent=50)
    rig.battery_v = 10.9
    rig.drive(pilot, (1.0, 0.0, 0.0), 1.5)
    assert rig.status().limits.why == (because(Code.BATTERY_LOW, volts=11.2), hot)
    assert rig.status().limits.speed_mps == pytest.approx(LOW_MPS)
    rig.battery_v, rig.servo_c = 12.6, 50.0
    rig.drive(pilot, (1.0, 0.0, 0.0), 1.0)
    assert rig.twist[0] == pytest.approx(LOW_MPS)
    arm_again(rig, pilot)
    rig.drive(pilot, (1.0, 0.0, 0.0), 1.5)
    assert rig.twist[0] == pytest.approx(1.0)
