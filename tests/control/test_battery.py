"""A low battery limits the speed for every operator and command."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.support.controller_harness import PERIOD_S, ROBOT, ControllerHarness, HarnessOperator
from tests.support.markdown_pages import page, section, tables
from tsd_twin.messages.cdr import BASE, ODOM
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.modes import ARMED, Mode
from tsd_twin.messages.topics import Service
from tsd_twin.simulation import SimRobot

BATTERY, LIMITS = ROBOT.battery, ROBOT.limits
LOW_MPS = BATTERY.low_speed_share * LIMITS.speed_mps
LOW_RAD_PER_S = BATTERY.low_speed_share * LIMITS.turn_rate_rad_per_s
LOW_S = 1.0
"""Time after which a low voltage takes effect."""


class Watched(ControllerHarness):
    """Compares every period with a speed limit computed from the voltages alone."""

    volts: float | None = None
    slow = False
    low_since_s = math.inf
    slow_periods = fast_periods = 0

    def tick(self, dt_s: float = PERIOD_S) -> None:
        """Run and check one period."""
        self.battery_v = self.volts
        before = self.twist.copy()
        super().tick(dt_s)
        self._reckon()
        self._check(before)

    def _reckon(self) -> None:
        if self.volts is None or math.isnan(self.volts):
            return
        if self.volts < BATTERY.warn_v:
            self.low_since_s = min(self.low_since_s, self.now_s)
            self.slow |= self.now_s - self.low_since_s >= LOW_S
        else:
            self.low_since_s = math.inf
            if self.volts > BATTERY.warn_v + 0.3 and self.mode not in ARMED:
                self.slow = False

    def _check(self, before: np.ndarray) -> None:
        told = self.status().limits
        assert bool(told.reason) == self.slow == (told.speed_mps <= LOW_MPS)
        change_mps = float(np.hypot(*(self.twist - before)[:2]))
        most_mps2 = max(LIMITS.acceleration_mps2, LIMITS.deceleration_mps2)
        assert change_mps <= PERIOD_S * most_mps2 + 1e-9, "no jump"
        speed_mps, was_mps = np.hypot(*self.twist[:2]), np.hypot(*before[:2])
        if not self.slow:
            self.fast_periods += speed_mps > LOW_MPS
            return
        self.slow_periods += speed_mps > 0.9 * LOW_MPS
        assert speed_mps <= max(LOW_MPS, was_mps - 1e-4) + 1e-9, "slower until it is slow"
        assert abs(self.twist[2]) <= max(LOW_RAD_PER_S, abs(before[2])) + 1e-9


def arm_again(rig: ControllerHarness, pilot: HarnessOperator) -> None:
    assert rig.ask(Service.DISARM, lease=pilot.lease).ok
    while rig.mode is not Mode.DISARMED:
        rig.drive(pilot, (0, 0, 0), 0.1)
    rig.drive(pilot, (0, 0, 0), 0.5)
    assert rig.ask(Service.ARM, lease=pilot.lease).ok
    while rig.mode is not Mode.READY:
        rig.drive(pilot, (0, 0, 0), 0.1)


@pytest.mark.parametrize("seed", range(3))
def test_no_voltage_lets_it_drive_faster_than_its_battery_allows(seed: int) -> None:
    random = np.random.default_rng(seed)
    rig = Watched()
    pilot = rig.get_ready()
    for _ in range(50):
        volts = [None, math.nan, random.uniform(9.0, 14.0), random.uniform(10.9, 11.6)]
        rig.volts = volts[random.integers(4)]
        if random.uniform() < 0.2:
            arm_again(rig, pilot)
        direction, frame = random.uniform(0.0, 2.0 * math.pi), (BASE, ODOM)[random.integers(2)]
        twist = (2.0 * math.cos(direction), 2.0 * math.sin(direction), random.uniform(-1.0, 1.0))
        rig.drive(pilot, twist, random.uniform(0.1, 1.5), frame)
    assert rig.slow_periods > 100
    assert rig.fast_periods > 100


def test_at_full_speed_it_slows_down_and_stays_slow_until_it_was_disarmed() -> None:
    rig = ControllerHarness(SimRobot(ROBOT))
    rig.battery_v = 12.0
    pilot = rig.get_ready()
    rig.drive(pilot, (1.0, 0.0, 0.0), 1.5)
    rig.controller.take_events()
    rig.battery_v = BATTERY.warn_v - 0.1
    rig.drive(pilot, (1.0, 0.0, 0.0), 0.9)
    rig.battery_v = BATTERY.warn_v + 0.1
    rig.drive(pilot, (1.0, 0.0, 0.0), 0.1)
    rig.battery_v = BATTERY.warn_v - 0.1
    rig.drive(pilot, (1.0, 0.0, 0.0), 0.9)
    assert rig.twist[0] == pytest.approx(1.0), "a motor that starts does that"
    rig.drive(pilot, (1.0, 0.0, 0.0), 0.12 + (1.0 - LOW_MPS) / LIMITS.deceleration_mps2)
    assert rig.twist[0] == pytest.approx(LOW_MPS)
    (event,) = [event for event in rig.controller.take_events() if event.kind == "battery"]
    low = because(Code.BATTERY_LOW, volts=11.2)
    assert event.why == because(Code.SLOWED, low, percent=50)
    assert rig.status().limits.why == (low,)
    rig.battery_v = 12.6
    rig.drive(pilot, (1.0, 0.0, 0.0), 2.0)
    assert rig.twist[0] == pytest.approx(LOW_MPS), "its load is gone, it is not charged"
    arm_again(rig, pilot)
    rig.drive(pilot, (1.0, 0.0, 0.0), 1.5)
    assert rig.twist[0] == pytest.approx(1.0)


def test_slow_it_stops_within_what_it_promises() -> None:
    rig = ControllerHarness(SimRobot(ROBOT))
    pilot = rig.get_ready()
    rig.battery_v = BATTERY.warn_v - 0.1
    rig.drive(pilot, (1.0, 0.0, 0.0), 2.5)
    start = rig.truth()
    rig.wait(1.5)  # The link is lost.
    assert rig.mode is Mode.READY
    way_m = float(np.hypot(*(rig.truth() - start)[:2]))
    assert 0.05 < way_m <= LIMITS.stop_allowance_m


def test_it_is_as_slow_and_as_soon_as_the_page_says() -> None:
    rig = ControllerHarness(SimRobot(ROBOT))
    rig.battery_v = 12.0
    pilot = rig.get_ready()
    rig.drive(pilot, (1.0, 0.0, 0.0), 2.0)
    rig.battery_v = 11.1
    start, start_s, lowered_s = rig.truth(), rig.now_s, math.inf
    while truth_mps(rig) > 1.01 * LOW_MPS:
        rig.drive(pilot, (1.0, 0.0, 0.0), PERIOD_S)
        if rig.status().limits.reason:
            lowered_s = min(lowered_s, rig.now_s - start_s)
        assert rig.now_s - start_s < 5.0
    slow_s, slow = rig.now_s - start_s, rig.truth()
    rig.wait(1.5)  # The link is lost.
    ways_m = [float(np.hypot(*(b - a)[:2])) for a, b in ((start, slow), (slow, rig.truth()))]
    ((row,),) = tables(section(page("bridge.md"), "## Battery"))
    assert row == ["11.1 V", *(f"{number:.2f}" for number in (lowered_s, slow_s, *ways_m))]


def truth_mps(rig: ControllerHarness) -> float:
    assert rig.simulated is not None
    return float(np.hypot(*rig.simulated.truth(rig.now_s).twist[:2]))
