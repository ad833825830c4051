"""When motors without a controller board may turn."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.hardware.drive_latch import (
    EMPTY_S,
    FOLLOWING_S,
    HEARTBEAT_TIMEOUT_S,
    BatteryWatch,
    DriveLatch,
    WheelFollowing,
)
from tsd_twin.hardware.joints import COMMAND_TIMEOUT_S, JointCommand
from tsd_twin.messages.codes import Code, because
from tsd_twin.safety import Heartbeat

pytestmark = pytest.mark.computes

STEP_S = 0.01
TROUBLE = because(Code.ALL_SERVOS_SILENT)
MOMENTS = st.lists(
    st.tuples(st.booleans(), st.booleans(), st.booleans(), st.booleans()), max_size=200
)


def command(armed: bool, counter: int, now_s: float) -> JointCommand:
    return JointCommand(np.zeros(3), Heartbeat(armed, counter), now_s)


@given(MOMENTS)
def test_wheels_turn_only_from_an_arming_until_the_first_trouble(
    moments: list[tuple[bool, bool, bool, bool]],
) -> None:
    latch, counter, may = DriveLatch(), 0, False
    seen_disarmed, given_s, beat_s, latest = False, 0.0, 0.0, command(True, 0, 0.0)
    for i, (armed, sends, beats, trouble) in enumerate(moments):
        now_s = 1.0 + 0.1 * i
        if sends:
            counter += beats
            latest, given_s = command(armed, counter, now_s), now_s
        turns = latch.step(latest, TROUBLE if trouble else None, now_s)
        fresh = now_s - given_s <= COMMAND_TIMEOUT_S and given_s > 0.0
        if fresh and not latest.heartbeat.armed:
            seen_disarmed, may = True, False
        elif fresh and seen_disarmed:
            seen_disarmed, may, beat_s = False, True, now_s
        if sends and beats:
            beat_s = now_s
        may = may and fresh and not trouble and now_s - beat_s <= HEARTBEAT_TIMEOUT_S + 1e-9
        assert turns == (may and latest.heartbeat.armed)
        if turns:
            assert latch.lost is None


def test_a_lock_needs_a_disarmed_command_first() -> None:
    latch = DriveLatch()
    latch.step(command(False, 0, 1.0), None, 1.0)
    latch.lock(TROUBLE)
    assert not latch.step(command(True, 1, 1.1), None, 1.1)
    latch.step(command(False, 1, 1.2), None, 1.2)
    assert latch.step(command(True, 2, 1.3), None, 1.3)


@given(st.floats(1.5, 10.0), st.sampled_from((-1.0, 1.0)))
def test_a_wheel_that_stands_is_found_at_any_speed_and_one_that_follows_never(
    speed: float, sign: float
) -> None:
    stuck, well = WheelFollowing(["a", "b"], 10.0), WheelFollowing(["a", "b"], 10.0)
    measured, found_s = np.zeros(2), np.inf
    for i in range(200):
        now_s, wanted = STEP_S * i, sign * speed * np.ones(2) * min(1.0, i / 50)
        measured = measured + (wanted - measured) * STEP_S / 0.05
        assert well.step(wanted, measured, now_s) is None
        reason = stuck.step(wanted, np.array([measured[0], 0.0]), now_s)
        if reason is not None and found_s == np.inf:
            found_s = now_s
            assert reason.params["wheel"] == "b"
    assert FOLLOWING_S <= found_s <= 0.5 + 0.3 + FOLLOWING_S + 0.1


def test_wheels_that_are_not_measured_are_not_stuck() -> None:
    monitor = WheelFollowing(["a"], 10.0)
    for i in range(200):
        assert monitor.step(np.array([5.0]), np.array([np.nan]), STEP_S * i) is None


def test_a_battery_stops_after_a_second_below_and_refuses_to_arm_at_once() -> None:
    watch = BatteryWatch(11.0, 10.0)
    assert watch.step(10.5, 0.0, armed=True) is None
    refused = watch.step(10.5, 0.1, armed=False)
    assert refused is not None
    assert refused.code == Code.BATTERY_TOO_LOW
    assert watch.step(9.0, 1.0, armed=True) is None
    assert watch.step(9.0, 1.0 + EMPTY_S - 0.01, armed=True) is None
    assert watch.step(10.1, 1.9, armed=True) is None, "a dip"
    assert watch.step(9.0, 2.0, armed=True) is None
    empty = watch.step(9.0, 2.0 + EMPTY_S, armed=True)
    assert empty == because(Code.BATTERY_EMPTY, volts=9.0)
