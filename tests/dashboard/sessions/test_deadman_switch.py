"""Deadman switch under any order of hold and release."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from tsd_twin.dashboard.sessions.teleop import DeadmanState, DeadmanSwitch


class AnyOrder(RuleBasedStateMachine):
    """Motion ends exactly once, and restarts only after a release."""

    def __init__(self) -> None:
        super().__init__()
        self.deadman = DeadmanSwitch()
        self.now_s = 0.0
        self.moving = False  # The last command was not zero.
        self.centred = True  # Released since the last forced release.

    @rule(dt_s=st.floats(0.0, 1.0))
    def drive(self, dt_s: float) -> None:
        self.now_s += dt_s
        passes = self.deadman.on_command(self.now_s)
        assert passes == self.centred
        self.moving = self.moving or passes

    @rule()
    def release(self) -> None:
        assert self.deadman.on_release() == self.moving
        self.moving, self.centred = False, True

    @rule()
    def let_go(self) -> None:
        ends = self.deadman.force_release()
        assert ends == self.moving
        if ends:
            self.moving, self.centred = False, False

    @invariant()
    def held_means_moving(self) -> None:
        assert (self.deadman.state is DeadmanState.HELD) == self.moving


TestAnyOrder = AnyOrder.TestCase


@given(st.floats(0.0, 1e6), st.floats(0.0, 10.0))
def test_silence_is_counted_from_the_newest_command_and_only_while_held(
    start_s: float, wait_s: float
) -> None:
    deadman = DeadmanSwitch()
    assert deadman.silence_s(start_s) == 0.0
    deadman.on_command(start_s)
    assert deadman.silence_s(start_s + wait_s) == (start_s + wait_s) - start_s
    deadman.force_release()
    assert deadman.silence_s(start_s + wait_s) == 0.0
