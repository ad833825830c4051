"""A stuck gimbal is a fault within about 1 s; a delayed or slow one is not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.controller_harness import ROBOT, ControllerHarness
from tsd_twin.control.monitors import (
    ASIDE_RAD,
    FOLLOWING_ERROR_TIMEOUT_S,
    REMEMBERED_S,
    FollowingErrorMonitor,
)
from tsd_twin.messages.codes import Code
from tsd_twin.messages.events import Event
from tsd_twin.messages.modes import Mode
from tsd_twin.simulation import DegradedRobot, SimRobot, StuckJoint

PERIOD_S = 0.01
LONGEST_S = FOLLOWING_ERROR_TIMEOUT_S + REMEMBERED_S + 0.1


def faults(rig: ControllerHarness) -> list[Event]:
    return [
        event for event in rig.controller.take_events() if event.why.params.get("after") == "fault"
    ]


@pytest.mark.parametrize("let_go", [False, True])
@pytest.mark.parametrize(("gimbal", "way_deg"), [("module1_alpha", 0.0), ("module3_beta", 330.0)])
def test_a_gimbal_that_sticks_shuts_off_the_wheels_and_is_named(
    gimbal: str, way_deg: float, let_go: bool
) -> None:
    way = (np.cos(np.radians(way_deg)), np.sin(np.radians(way_deg)), 0.0)
    simulated = DegradedRobot(ROBOT, seed=2, noise=1.0)
    rig = ControllerHarness(simulated)
    pilot = rig.get_ready()
    simulated.jam(StuckJoint(gimbal, np.radians(2.0)))
    rig.drive(pilot, way, 0.4)
    if not let_go:
        rig.drive(pilot, way, LONGEST_S)
    else:
        rig.drive(pilot, (0.0, 0.0, 0.0), 0.3 + LONGEST_S)
    assert rig.mode is Mode.FAULT
    stop = rig.status().stop
    assert (stop.code, stop.params["joint"]) == (Code.FOLLOWING_ERROR, gimbal)
    assert len(faults(rig)) == 1
    assert not rig.setpoint[rig.wheels].any()
    rig.drive(pilot, way, 1.0)
    status = rig.status()
    assert status.mode == Mode.FAULT, "it is latched"
    assert status.consistency.suspect == gimbal.split("_", maxsplit=1)[0], "what told stays seen"


@settings(max_examples=20)
@given(
    seed=st.integers(0, 1000),
    errors=st.sampled_from([0.0, 1.0]),
    holds=st.lists(st.floats(0.05, 0.8), min_size=3, max_size=6),
)
def test_gimbals_that_turn_are_never_a_fault(seed: int, errors: float, holds: list[float]) -> None:
    dice = np.random.default_rng(seed)
    rig = ControllerHarness(SimRobot(ROBOT, seed=seed, noise=1.0, errors=errors))
    pilot = rig.get_ready()
    for seconds in holds:
        rig.drive(pilot, tuple(dice.uniform(-1.0, 1.0, 3) * (1.0, 1.0, 3.0)), seconds)
    rig.drive(pilot, (0.0, 0.0, 0.0), 1.0)
    assert faults(rig) == []


@given(
    lag=st.integers(0, round(REMEMBERED_S / PERIOD_S) - 1),
    amplitude=st.floats(0.0, 1.0),
    turn=st.floats(0.1, 20.0),
)
def test_what_comes_late_is_no_fault_however_fast_it_is_told(
    lag: int, amplitude: float, turn: float
) -> None:
    following = FollowingErrorMonitor(["a"])
    times = PERIOD_S * np.arange(200)
    told = amplitude * np.sin(turn * times)
    for i, now_s in enumerate(times):
        measured = told[max(i - lag, 0)]
        assert following.step(float(now_s), told[i : i + 1], np.array([measured])) is None


@given(off=st.floats(-1.0, 1.0), at=st.integers(0, 1))
def test_what_stays_away_is_one_after_its_patience_and_not_before(off: float, at: int) -> None:
    following = FollowingErrorMonitor(["a", "b"])
    aside = np.zeros(2)
    aside[at] = off
    said = [following.step(PERIOD_S * i, np.zeros(2), aside) for i in range(150)]
    late = [i * PERIOD_S for i, text in enumerate(said) if text]
    if abs(off) <= ASIDE_RAD:
        assert late == []
    else:
        assert late[0] == pytest.approx(FOLLOWING_ERROR_TIMEOUT_S, abs=1.5 * PERIOD_S)
        assert said[-1].code == Code.FOLLOWING_ERROR
        assert said[-1].params["joint"] == "ab"[at]


def test_no_number_is_no_fault_and_a_gap_does_not_count_for_one() -> None:
    following = FollowingErrorMonitor(["a"])
    for i in range(200):
        assert following.step(PERIOD_S * i, np.zeros(1), np.array([np.nan])) is None
    following.forget()
    assert following.step(100.0, np.zeros(1), np.ones(1)) is None
