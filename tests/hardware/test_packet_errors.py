"""When a line is too dirty to drive over, in virtual time, against a count of every window."""

from __future__ import annotations

from copy import copy

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.hardware.link_health import LIMIT, WINDOW_S, LinkHealth
from tsd_twin.messages.codes import Code

pytestmark = pytest.mark.computes

CYCLES = st.lists(
    st.tuples(st.integers(1, 40), st.booleans() | st.just(False)), min_size=1, max_size=300
)
"""Time that each cycle took, in units of 1 / `PER_S`, and whether something was broken in it."""
PER_S = 1024
"""Times are exact in binary, so at the edge of a window both counts agree."""


def lived_through(cycles: list[tuple[int, bool]]) -> list[tuple[int, list[int], LinkHealth]]:
    """Return, for each cycle, when it ended, which spoilt ones are in the window, and the noise."""
    noise, now, spoilt_at, seen = LinkHealth("board"), 0, [], []
    for took, spoilt in cycles:
        now += took
        if spoilt:
            spoilt_at.append(now)
        noise.add_packets(spoilt, now / PER_S)
        window = [at for at in spoilt_at if at > now - PER_S * WINDOW_S]
        seen.append((now, window, copy(noise)))
    return seen


@given(CYCLES)
def test_it_is_a_fault_from_the_fifth_in_a_window_until_a_window_without_any(
    cycles: list[tuple[int, bool]],
) -> None:
    dirty = False
    for _, window, noise in lived_through(cycles):
        dirty = len(window) >= LIMIT or (dirty and bool(window))
        assert bool(noise.packet_fault) == dirty
        assert noise.suspicion or len(window) < 2
        assert window or not noise.suspicion


@given(CYCLES)
def test_what_it_says_stays_the_same_while_it_lasts_and_counts_what_there_was(
    cycles: list[tuple[int, bool]],
) -> None:
    before = None
    for now, window, noise in lived_through(cycles):
        if noise.packet_fault and not before:
            assert noise.packet_fault.code == Code.LINE_GARBAGE
            assert noise.packet_fault.params["count"] == len(window)
            lately_s = pytest.approx((now - window[0]) / PER_S, abs=0.006)
            assert noise.packet_fault.params["s"] == lately_s
        elif noise.packet_fault:
            assert noise.packet_fault == before
        before = noise.packet_fault
    assert noise.corrupt == sum(spoilt for _, spoilt in cycles)


@given(st.lists(st.integers(round(1000 * WINDOW_S / (LIMIT - 1)) + 1, 5000), max_size=200))
def test_one_now_and_then_stops_nobody(pauses_ms: list[int]) -> None:
    noise, now_s = LinkHealth("board"), 0.0
    for pause_ms in pauses_ms:
        now_s += pause_ms / 1000.0
        noise.add_packets(True, now_s)
        assert not noise.packet_fault
