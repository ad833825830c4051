"""A `cmd_vel` publisher behind a slow link drives smoothly under a suitable lease."""

from __future__ import annotations

import pytest

from tests.support.controller_harness import PERIOD_S, ROBOTS, DelayedClient
from tsd_twin.adapters.cmd_vel_bridge import REFRESH_S, command_age_for
from tsd_twin.adapters.foxglove.gateway import PING_S

BUS_S = 0.004


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("trip_s", [0.001, 0.02, 0.03, 0.05, 0.1, 0.2])
def test_twists_at_10_hz_drive_without_a_break(name: str, trip_s: float) -> None:
    max_age_s = command_age_for(ROBOTS[name].limits, trip_s)
    client = DelayedClient(name, 0.5 * BUS_S, 0.5 * BUS_S, max_age_s)
    assert client.max_age_s == pytest.approx(max_age_s)
    assert client.drive_for(20, 10, trip_s + PING_S) > 2.0 - 4 * PERIOD_S
    assert not client.failures
    assert client.rig.status().stops == 0


@pytest.mark.parametrize("name", ROBOTS)
def test_a_near_publisher_has_the_full_speed(name: str) -> None:
    limits = ROBOTS[name].limits
    assert command_age_for(limits, 0.0) == limits.max_command_age_s
    assert command_age_for(limits, 0.01) == limits.max_command_age_s
    assert command_age_for(limits, 0.3) == pytest.approx(0.3 + REFRESH_S)
    assert command_age_for(limits, 30.0) == limits.max_command_age_ceiling_s
