"""Input age: repeated setpoints never move the robot longer than the gate allows.

Protocol and robot controller in virtual time, with delays, losses and pauses.
"""

from __future__ import annotations

from collections import deque

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.controller_harness import PERIOD_S, ROBOTS, DelayedClient
from tsd_twin.client.echoes import NEVER_SENT, Echoes
from tsd_twin.messages.modes import Mode

SETTLED_S = 3.0
"""After this time a disconnected robot is at rest."""


@given(
    name=st.sampled_from(sorted(ROBOTS)),
    max_age_s=st.sampled_from([None, 0.5, 1.0]),
    up_s=st.floats(0.0, 0.15),
    down_s=st.floats(0.0, 0.15),
    period_s=st.floats(0.02, 0.2),
    ages_s=st.lists(st.floats(0.0, 0.4), min_size=20, max_size=20),
    events=st.lists(
        st.tuples(st.floats(0.0, 0.3), st.sampled_from(["up", "down", "pause", "silence"])),
        min_size=1,
        max_size=4,
    ),
)
def test_no_input_moves_the_robot_for_longer_than_its_command_age(
    name: str,
    max_age_s: float | None,
    up_s: float,
    down_s: float,
    period_s: float,
    ages_s: list[float],
    events: list[tuple[float, str]],
) -> None:
    """For failures of any component, in any order, before or after the last input."""
    client = DelayedClient(name, up_s, down_s, max_age_s)
    bound_s = client.max_age_s + 2 * PERIOD_S
    silent, next_s, waiting = False, client.rig.now_s, list(ages_s)
    upcoming = deque(events)
    event_s = client.rig.now_s + 0.5
    end_s = event_s + sum(wait_s for wait_s, _ in events) + SETTLED_S
    while client.rig.now_s < end_s:
        if client.rig.now_s >= next_s and not (silent or client.paused):
            client.give(waiting.pop() if waiting else 0.0)
            next_s = client.rig.now_s + period_s
        if upcoming and client.rig.now_s >= event_s:
            wait_s, event = upcoming.popleft()
            event_s = client.rig.now_s + wait_s
            client.up_lost |= event == "up"
            client.down_lost |= event == "down"
            client.paused |= event == "pause"
            silent |= event == "silence"
        client.tick()
        assert not client.drives or client.rig.now_s <= client.given_s + bound_s


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("trip_s", [0.0, 0.02, 0.06])
@pytest.mark.parametrize("phase", range(5))
def test_one_set_velocity_moves_the_robot_and_brings_it_to_rest(
    name: str, trip_s: float, phase: int
) -> None:
    """The zero arrives before the command timeout of the robot."""
    client = DelayedClient(name, 0.5 * trip_s, 0.5 * trip_s, None)
    client.wait(phase * PERIOD_S)
    for _ in range(2):
        client.give()
        moved_s = 0.0
        for _ in range(round(0.4 / PERIOD_S)):
            client.tick()
            moved_s += client.drives * PERIOD_S
        assert 0.055 <= moved_s <= 0.215, client.failures
        client.wait(1.0)
        assert client.rig.mode is Mode.READY
    assert not client.failures
    assert client.rig.status().stops == 0


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize(("trip_s", "input_age_s"), [(0.0, 0.02), (0.02, 0.05), (0.06, 0.05)])
def test_a_stream_at_20_hz_drives_without_a_break(
    name: str, trip_s: float, input_age_s: float
) -> None:
    client = DelayedClient(name, 0.5 * trip_s, 0.5 * trip_s, None)
    assert client.drive_for(40, 5, input_age_s) > 2.0 - trip_s - 2 * PERIOD_S
    assert not client.failures
    assert client.rig.status().stops == 0


@given(st.lists(st.floats(0.001, 0.2), min_size=1, max_size=100), st.floats(-1.0, 30.0))
def test_an_echo_is_the_status_that_was_current(gaps_s: list[float], time_s: float) -> None:
    echoes, received, now_s = Echoes(), [NEVER_SENT], 0.0
    for seq, gap_s in enumerate(gaps_s, 1):
        now_s += gap_s
        echoes.add(seq, now_s)
        received.append((seq, now_s))
    found = echoes.at(time_s)
    assert found == [row for row in received if row[1] <= time_s][-1] or found == NEVER_SENT
    if time_s >= now_s:
        assert found == received[-1]
