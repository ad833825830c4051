"""Counters of answers, and what they say about cables."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.hardware.cables import LEAST, CableMonitor
from tsd_twin.hardware.joints import ServoNames

pytestmark = pytest.mark.computes

TSD = ServoNames([f"module{i}_{angle}" for i in (1, 2, 3) for angle in ("alpha", "beta")])
KIWI = ServoNames(["wheel1", "wheel2", "wheel3"])


@given(
    st.integers(1, 7),
    st.lists(st.tuples(st.booleans(), st.floats(0.005, 0.05)), min_size=50, max_size=300),
)
def test_counters_are_those_of_a_plain_count(mask: int, cycles: list[tuple[bool, float]]) -> None:
    monitor, now_s, missed, longest = CableMonitor(KIWI), 0.0, 0, 0.0
    heard_s = [0.0] * 3
    monitor.add_cycle(0, now_s, broken=False)
    for misses, pause_s in cycles:
        now_s += pause_s
        missing = mask if misses else 0
        missed += misses
        for i in range(3):
            if not missing >> i & 1:
                longest = max(longest, now_s - heard_s[i])
                heard_s[i] = now_s
        monitor.add_cycle(missing, now_s, broken=False)
    shown = monitor.status()
    assert shown["missed"] == [missed if mask >> i & 1 else 0 for i in range(3)]
    assert max(shown["longest_silence_ms"]) == pytest.approx(1000.0 * longest, abs=1.0)
    assert bool(monitor.findings()) == (missed >= LEAST)


def test_late_answers_are_not_missing() -> None:
    monitor = CableMonitor(KIWI)
    for i in range(100):
        monitor.add_cycle(2 if i % 2 else 0, 0.01 * i, broken=False, late=i % 2 == 0)
    shown = monitor.status()
    assert shown["late"] == [0, 49, 0]
    assert shown["missed"] == [0, 1, 0]
    assert not monitor.findings()


def test_the_sentence_has_the_figures() -> None:
    monitor = CableMonitor(TSD)
    for i in range(5000):
        monitor.add_cycle(0b1000 if i % 98 == 0 else 0, 0.01 * i, broken=False)
    assert monitor.sentences() == [
        "servo 4 (module2_beta): 52 of 5,000 answers missing, those behind it none: its plug"
    ]
    assert np.all(np.array(monitor.status()["missed"]) == [0, 0, 0, 52, 0, 0])
