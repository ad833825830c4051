"""Roster of the robots: their order in the menu, and the colour that tells each from the others."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence

from tsd_twin.dashboard.scene.appearance import Rgb

ROBOT_COLOURS: tuple[Rgb, ...] = (
    (11, 132, 216),
    (217, 101, 10),
    (15, 157, 118),
    (192, 90, 168),
    (169, 130, 0),
    (125, 120, 216),
    (224, 72, 122),
    (95, 143, 47),
)
"""Each has a contrast of 3 : 1 and more against the light and against the dark surfaces."""


class RobotRoster:
    """Order and colours of robots, the same on all pages and in the scene; thread-safe.

    The robots that were named come first, in that order; a page that opens shows the first one. The
    others follow by id. A robot keeps its colour; when all are in use, they are used again.
    """

    def __init__(self, first: Sequence[str] = ()) -> None:
        """`first` are ids of robots, which may appear later, or never."""
        self._lock = threading.Lock()
        self._first = {robot_id: place for place, robot_id in enumerate(dict.fromkeys(first))}
        self._numbers = dict(self._first)

    def in_order(self, robot_ids: Iterable[str]) -> list[str]:
        """Return robots in the order of the menu."""
        last = len(self._first)
        return sorted(robot_ids, key=lambda each: (self._first.get(each, last), each))

    def colour(self, robot_id: str) -> Rgb:
        """Return the colour of a robot."""
        with self._lock:
            number = self._numbers.setdefault(robot_id, len(self._numbers))
        return ROBOT_COLOURS[number % len(ROBOT_COLOURS)]
