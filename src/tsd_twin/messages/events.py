"""Events of a robot."""

from __future__ import annotations

from typing import Any

import msgspec

from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.sentences import full_sentence, sentence


class Event(msgspec.Struct, frozen=True):
    """`event/<kind>`: event for operators and logs."""

    kind: str
    text: str
    """Single sentence."""
    requested: Any = None
    applied: Any = None
    rule: str = ""
    """Rule that was applied."""
    robot_s: float = 0.0
    """Robot's monotonic time."""
    why: Reason | None = None
    """Code and parameters behind `text`."""

    @staticmethod
    def of(
        kind: str,
        why: Reason,
        rule: str,
        robot_s: float,
        requested: Any = None,
        applied: Any = None,
    ) -> Event:
        """Event for a reason."""
        return Event(kind, full_sentence(why), requested, applied, rule, robot_s, why)


def duplicate_id_text(robot_id: str) -> str:
    """Return the error text for several robots with the same id."""
    return sentence(because(Code.DUPLICATE_ID, robot=robot_id))
