"""The controls of a page, held and let go, in any order."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from tsd_twin.dashboard.grip import Grip, Hold


class AnyOrder(RuleBasedStateMachine):
    """Whatever happens: motion is ended once, and begins again only after a release."""

    def __init__(self) -> None:
        super().__init__()
        self.grip = Grip()
        self.now_s = 0.0
        self.moving = False  # The last that the robot was told was not zero.
        self.centred = True  # The page has released since somebody let go for it.

    @rule(dt_s=st.floats(0.0, 1.0))
    def drive(self, dt_s: float) -> None:
        self.now_s += dt_s
        passes = self.grip.drive(self.now_s)
        assert passes == self.centred
        self.moving = self.moving or passes

    @rule()
    def release(self) -> None:
        assert self.grip.release() == self.moving
        self.moving, self.centred = False, True

    @rule()
    def let_go(self) -> None:
        ends = self.grip.let_go()
        assert ends == self.moving
        if ends:
            self.moving, self.centred = False, False

    @invariant()
    def held_means_moving(self) -> None:
        assert (self.grip.hold is Hold.HELD) == self.moving


TestAnyOrder = AnyOrder.TestCase


@given(st.floats(0.0, 1e6), st.floats(0.0, 10.0))
def test_silence_is_counted_from_the_newest_command_and_only_while_held(
    start_s: float, wait_s: float
) -> None:
    grip = Grip()
    assert grip.silent_for_s(start_s) == 0.0
    grip.drive(start_s)
    assert grip.silent_for_s(start_s + wait_s) == (start_s + wait_s) - start_s
    grip.let_go()
    assert grip.silent_for_s(start_s + wait_s) == 0.0
