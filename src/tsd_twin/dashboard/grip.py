"""Whether a page holds the controls of a robot: a small state machine, time is an argument."""

from __future__ import annotations

from enum import StrEnum

SILENT_S = 0.2
"""A page that sends no command for this long is taken to have let go."""


class Hold(StrEnum):
    """What the page has done with the controls."""

    FREE = "free"
    """They are centred, or nobody touches them."""
    HELD = "held"
    SPENT = "spent"
    """Somebody let go for the page; until it has centred its controls, they do nothing."""


class Grip:
    """Each change that has to put the robot at rest returns True exactly once."""

    def __init__(self) -> None:
        self.hold = Hold.FREE
        self._driven_s = 0.0

    def drive(self, now_s: float) -> bool:
        """Note a command, and return whether it may go to the robot."""
        if self.hold is Hold.SPENT:
            return False
        self.hold, self._driven_s = Hold.HELD, now_s
        return True

    def release(self) -> bool:
        """Note that the page has centred its controls."""
        was, self.hold = self.hold, Hold.FREE
        return was is Hold.HELD

    def let_go(self) -> bool:
        """Let go on behalf of the page, which must centre its controls to drive again."""
        if self.hold is not Hold.HELD:
            return False
        self.hold = Hold.SPENT
        return True

    def refuse(self) -> bool:
        """Note a command that may not go anywhere: who holds a control now must centre it first."""
        was, self.hold = self.hold, Hold.SPENT
        return was is not Hold.SPENT

    def silent_for_s(self, now_s: float) -> float:
        """Return the time since the newest command; 0 when nothing is held."""
        return now_s - self._driven_s if self.hold is Hold.HELD else 0.0
