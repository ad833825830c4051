"""Stopping distance of each built-in robot from full speed after loss of one or both directions."""

from __future__ import annotations

import copy
from collections import deque

import numpy as np
import pytest

from tests.support.controller_harness import PERIOD_S, ControllerHarness, HarnessOperator
from tsd_twin import robots
from tsd_twin.lie import SE2, SO3
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.topics import Sample
from tsd_twin.simulation import SimRobot

UP, DOWN = "up", "down"
LOSSES = {"uplink, or both ways": {UP}, "downlink only": {DOWN}}
"""Without an uplink, the downlink has no effect, so losing both is the same case."""
LONGER_AGES_S = (0.25, 0.5, 1.0)
CASES = [
    (name, max_age_s)
    for name in robots.robot_names()
    for max_age_s in (None, *LONGER_AGES_S)
    if max_age_s != robots.load_robot(name).limits.max_command_age_s
]
"""Each robot with its default maximum command age, and with longer ones requested by leases."""
DELAY_SHARES = (0.0, 0.3)
"""One-way delay as a fraction of the maximum command age: a fast and a slow link."""
PHASES = 10
"""Number of ticks in which a status (every 5th) and a command (every 2nd) take all phases."""
CRUISE_S = 2.0
LONGEST_S = 4.0
RESTS_S = 0.3
"""Longer than any message is in flight."""
HASTE = 2.0
"""Factor of requested over allowed speed, so that the robot's limit applies."""


class Far:
    """Operator behind a link with constant delay, who never releases the stick.

    As a careless client, it always sends the latest received status number, however old.
    """

    def __init__(
        self, rig: ControllerHarness, pilot: HarnessOperator, delay_s: float, speed: float
    ) -> None:
        self.rig, self.pilot, self.delay_s, self.speed = rig, pilot, delay_s, speed
        self.lost: set[str] = set()
        self._up: deque[tuple[float, Sample]] = deque()
        self._down: deque[tuple[float, int]] = deque()
        self._seen = self._heard = rig.status_seq
        self._ticks = 0

    def tick(self) -> None:
        """Run one period; packets sent before a loss still arrive."""
        rig = self.rig
        if rig.status_seq != self._heard:
            self._heard = rig.status_seq
            if DOWN not in self.lost:
                self._down.append((rig.now_s + self.delay_s, self._heard))
        while self._down and self._down[0][0] <= rig.now_s + 1e-9:
            self._seen = self._down.popleft()[1]
        if self._ticks % 2 == 0 and UP not in self.lost:
            command = rig.sample(self.pilot, (self.speed, 0.0, 0.0), status_seq=self._seen)
            self._up.append((rig.now_s + self.delay_s, command))
        while self._up and self._up[0][0] <= rig.now_s + 1e-9:
            rig.inbox.append(self._up.popleft()[1])
        self._ticks += 1
        rig.tick()

    def way_until_rest_m(self) -> float:
        """Return the travel until the robot has been at rest for `RESTS_S`."""
        rig, way_m, ticks, resting = self.rig, 0.0, 0, 0
        while resting * PERIOD_S < RESTS_S:
            before = pose(rig)
            self.tick()
            step_m = self.step_m(before)
            way_m += step_m
            ticks += 1
            resting = resting + 1 if rig.mode is Mode.READY and step_m < 1e-6 else 0
            assert ticks * PERIOD_S < LONGEST_S, f"still {rig.mode} after {way_m:.2f} m"
        return way_m

    def step_m(self, before: SE2 | SO3) -> float:
        """Return the distance from a pose; for a sphere, the distance moved by the top."""
        after = pose(self.rig)
        if isinstance(before, SE2):
            moved = after.xy_heading - before.xy_heading
        else:  # In base axes, like the sphere's twist.
            moved = (after @ before.inverse()).log()  # pyright: ignore[reportOperatorIssue]
        return float(self.rig.controller.kinematics.twist_scale_m * np.hypot(moved[0], moved[1]))


def pose(rig: ControllerHarness) -> SE2 | SO3:
    assert rig.simulated is not None
    return rig.simulated.truth(rig.now_s).pose


def at_full_speed(name: str, max_age_s: float | None, delay_s: float) -> Far:
    robot = robots.load_robot(name)
    rig = ControllerHarness(SimRobot(robot), robot=robot)
    pilot = rig.get_ready(max_age_s=max_age_s)
    twist_scale_m, cap_mps = rig.controller.kinematics.twist_scale_m, rig.status().limits.speed_mps
    far = Far(rig, pilot, delay_s, HASTE * cap_mps / twist_scale_m)
    for _ in range(round(CRUISE_S / PERIOD_S)):
        far.tick()
    assert rig.mode is Mode.DRIVING
    assert rig.status().stops == 0
    assert rig.twist[0] * twist_scale_m == pytest.approx(cap_mps, rel=0.01)
    return far


@pytest.mark.parametrize(("name", "max_age_s"), CASES)
def test_it_stands_within_its_allowance_whichever_way_of_the_link_is_lost(
    name: str, max_age_s: float | None
) -> None:
    """From full speed under the lease, at the worst message phase."""
    limits = robots.load_robot(name).limits
    allowed_m = limits.stop_allowance_m
    age_s = limits.max_command_age_s if max_age_s is None else max_age_s
    too_far: dict[str, str] = {}
    for share in DELAY_SHARES:
        far = at_full_speed(name, max_age_s, share * age_s)
        worst_m = dict.fromkeys(LOSSES, 0.0)
        for _ in range(PHASES):
            far.tick()
            for loss, ways in LOSSES.items():
                robot = far.rig.controller.robot  # Never changes, unlike the rest.
                cut = copy.deepcopy(far, {id(robot): robot})
                cut.lost = ways
                worst_m[loss] = max(worst_m[loss], cut.way_until_rest_m())
        for loss, way_m in worst_m.items():
            assert way_m > 0.0
            if way_m > allowed_m:
                too_far[f"{loss}, delay {share * age_s:g} s"] = f"{way_m:.3f} m"
    assert not too_far, f"at most {allowed_m:g} m are promised"
