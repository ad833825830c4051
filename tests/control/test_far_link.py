"""Driving over a slow link continues through gaps; after link loss the robot stops in time."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.support.controller_harness import ControllerHarness, HarnessOperator
from tsd_twin.link_emulation import LinkSpec
from tsd_twin.link_emulation.link import LinkModel
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.topics import Sample

SIZE_BYTES = 150


class Far:
    """Harness with an operator behind a slow link that loses single packets."""

    def __init__(
        self, rig: ControllerHarness, pilot: HarnessOperator, spec: str, seed: int
    ) -> None:
        self.rig, self.pilot = rig, pilot
        parsed = LinkSpec.parse(spec)
        self.up: LinkModel[Sample]
        self.down: LinkModel[int]
        self.up, self.down = (
            LinkModel(parsed, np.random.default_rng([seed, way]), rig.now_s, 1e9) for way in (0, 1)
        )
        self.seen = self._sent = rig.status_seq
        self._ticks = itertools.count()

    def hold(self, vx: float, seconds: float) -> None:
        """Hold the stick over a link that may delay both directions."""
        rig = self.rig
        for _ in range(round(seconds / 0.01)):
            if rig.status_seq != self._sent:
                self._sent = rig.status_seq
                self.down.send(self._sent, SIZE_BYTES, rig.now_s)
            for seq in self.down.receive(rig.now_s):
                self.seen = max(self.seen, seq)
            if next(self._ticks) % 2 == 0:
                command = rig.sample(self.pilot, (vx, 0.0, 0.0), status_seq=self.seen)
                self.up.send(command, SIZE_BYTES, rig.now_s)
            self._tick()

    def lose_the_link(self, seconds: float) -> None:
        """Drop all further packets; those in flight still arrive."""
        for _ in range(round(seconds / 0.01)):
            self._tick()

    def _tick(self) -> None:
        self.rig.inbox.extend(self.up.receive(self.rig.now_s))
        self.rig.tick()


def driving(rig: ControllerHarness, spec: str, seed: int, max_age_s: float) -> Far:
    pilot = rig.get_ready(max_age_s=max_age_s)
    far = Far(rig, pilot, spec, seed)
    far.hold(0.0, 1.0)
    far.hold(1.0, 2.0)
    return far


@pytest.mark.parametrize("seed", range(3))
def test_over_a_far_and_lossy_link_somebody_drives_ten_seconds_without_a_break(seed: int) -> None:
    rig = ControllerHarness()
    far = driving(rig, "delay=150ms,jitter=30ms,loss=2%", seed, 1.0)
    stops = rig.status().stops
    start = rig.pose[0]
    far.hold(1.0, 10.0)
    assert (rig.mode, rig.status().stops) == (Mode.DRIVING, stops)
    assert rig.pose[0] - start == pytest.approx(10.0 * rig.status().limits.speed_mps, rel=0.01)


def test_a_gap_as_long_as_the_lease_allows_is_bridged_and_no_longer(rig: ControllerHarness) -> None:
    """Under a lease of 1 s, commands are valid until 1 s after the echoed status was sent."""
    pilot = rig.get_ready(max_age_s=1.0)
    rig.drive(pilot, (1.0, 0.0, 0.0), 1.0)
    sent_s = rig.status_sent_s[rig.status_seq]
    rig.send(pilot, (1.0, 0.0, 0.0))
    while rig.mode is Mode.DRIVING:
        rig.tick()
    assert rig.now_s - sent_s == pytest.approx(0.99, abs=0.025)


@pytest.mark.parametrize(
    ("delay_ms", "max_age_s"),
    [(0, 1.0), (50, 0.4), (50, 1.0), (120, 0.58), (300, 1.0), (440, 1.0)],
)
def test_when_a_far_link_is_lost_it_stands_within_35_cm(
    sim_rig: ControllerHarness, delay_ms: int, max_age_s: float
) -> None:
    rig = sim_rig
    far = driving(rig, f"delay={delay_ms}ms", 0, max_age_s)
    assert rig.mode is Mode.DRIVING
    before = rig.truth()
    far.lose_the_link(2.0)
    assert rig.mode is Mode.READY
    assert 0.0 < np.hypot(*(rig.truth() - before)[:2]) <= 0.35
    assert not rig.twist.any()
