"""Stop reasons name the limit that fired, with its values."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.safety.supervisor_harness import PERIOD_S, SupervisorHarness
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.modes import Mode

MAX_AGES_S = (0.21, 0.5)


@dataclass
class Sent:
    arrived_s: float
    echoed_s: float


class Timed:
    """A driving robot, and an operator whose commands have chosen times and ages."""

    def __init__(self, max_age_s: float) -> None:
        self.stage = SupervisorHarness()
        self.stage.bring_to(Mode.READY)
        self.stage.acquire(take_over=True, max_age_s=max_age_s)
        self.stage.wait(0.5)
        self.stage.hold(0.1, 1.0, at_rest=False)
        assert self.stage.mode is Mode.DRIVING
        self.lease = self.stage.supervisor.lease_in_force(self.stage.now_s)
        self.newest = Sent(self.stage.now_s - 0.02, self.stage.now_s - 0.02)

    def send(self, echo_age_steps: int, vx_mps: float) -> None:
        """Send a command that echoes a status of 50 ms steps ago, and record the echo."""
        stage = self.stage
        number, newest = max(1, stage.status_seq - echo_age_steps), stage.status_seq
        stage.status_seq = number
        stage.send(vx_mps)
        stage.status_seq = newest
        self.newest = Sent(stage.now_s, stage.status_sent_s[number])


timings = st.lists(
    st.tuples(st.integers(0, 30), st.integers(0, 12), st.sampled_from([1.0, 0.0])), max_size=12
)


@given(timings=timings, max_age_s=st.sampled_from(MAX_AGES_S))
def test_the_cause_named_is_the_limit_that_fired_and_its_figures_are_those_measured(
    timings: list[tuple[int, int, float]], max_age_s: float
) -> None:
    timed = Timed(max_age_s)
    stage, lease = timed.stage, timed.lease
    timed.send(0, 1.0)
    for periods, echo_age_steps, vx_mps in [*timings, (60, 0, 0.0)]:
        for _ in range(periods):
            stage.wait(PERIOD_S)
            if stage.mode is not Mode.DRIVING:
                break
        if stage.mode is not Mode.DRIVING:
            break
        timed.send(echo_age_steps, vx_mps)
    assert stage.mode is Mode.STOPPING
    newest, why = timed.newest, stage.supervisor.why
    if why.code == Code.NO_COMMAND:
        measured_s, limit_s = stage.now_s - newest.arrived_s, lease.timeout_s
        assert newest.arrived_s - newest.echoed_s <= lease.max_age_s
    else:
        assert why.code == Code.ECHO_TOO_OLD
        measured_s, limit_s = stage.now_s - newest.echoed_s, lease.max_age_s
    shown_ms, shown_limit_ms = why.params["ms"], why.params["limit_ms"]
    assert shown_ms == pytest.approx(1000.0 * measured_s, abs=0.51)
    assert shown_limit_ms == pytest.approx(1000.0 * limit_s, abs=0.51)
    assert measured_s > limit_s, "the limit that is named is exceeded"


def test_a_stop_by_the_age_of_the_echo_is_no_silence() -> None:
    """A command nearly too old on arrival keeps the robot moving only briefly."""
    timed = Timed(0.21)
    timed.send(1, 1.0)
    timed.stage.wait(0.19)
    assert timed.stage.supervisor.why.code == Code.ECHO_TOO_OLD


def test_commands_that_echo_no_status_of_this_robot_are_named() -> None:
    stage = Timed(0.21).stage
    for _ in range(25):
        stage.status_seq += 1_000_000
        stage.send(1.0)
        stage.status_seq -= 1_000_000
        stage.wait(PERIOD_S)
    assert stage.supervisor.why == because(Code.ECHO_UNKNOWN, limit_ms=210)
