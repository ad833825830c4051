"""The one loop that moves data: from the bus to the scene, and word of it to the gateway."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import Protocol

from tsd_twin.dashboard.fleet import Fleet
from tsd_twin.dashboard.link import RobotLink
from tsd_twin.messages.service import Event

_LOG = logging.getLogger(__name__)

RATE_HZ = 60.0
STALE_S = 0.3
"""A picture older than this must not look live."""


class Canvas(Protocol):
    """What draws robots."""

    def add(self, link: RobotLink) -> None:
        """Begin to draw a robot."""
        ...

    def draw(self) -> None:
        """Draw what is new."""
        ...

    def mark_stale(self, robot_id: str, stale: bool) -> None:
        """Make a robot look stale, or live."""
        ...


class Ticker:
    """Polls all robots at 60 Hz on a thread of its own."""

    def __init__(
        self,
        fleet: Fleet,
        canvas: Canvas,
        on_status: Callable[[str], None],
        on_event: Callable[[str, Event], None],
    ) -> None:
        """`on_status` and `on_event` are called on the ticker's thread and only hand over."""
        self._fleet = fleet
        self._canvas = canvas
        self._on_status = on_status
        self._on_event = on_event
        self._stale: dict[str, bool] = {}

    def run(self, stop: threading.Event) -> None:
        """Run until `stop` is set."""
        # A new look takes a second to draw: the robots that are there already are polled meanwhile.
        with ThreadPoolExecutor(1, "canvas") as drawing:
            while not stop.wait(1.0 / RATE_HZ):
                try:
                    self._tick(time.monotonic(), drawing)
                except Exception:  # A frame that fails must not end the picture for everybody.
                    _LOG.exception("a frame was lost")
            drawing.shutdown(wait=False, cancel_futures=True)

    def _add(self, link: RobotLink) -> None:
        try:
            self._canvas.add(link)
        except Exception:  # Descriptions come from the bus; the others are drawn all the same.
            _LOG.exception("robot %s cannot be drawn", link.id)
        self._stale.pop(link.id, None)  # What is new on the canvas looks live.

    def _tick(self, now_s: float, drawing: Executor) -> None:
        for robot_id in self._fleet.refresh():
            drawing.submit(self._add, self._fleet.links[robot_id])
        for robot_id, event in self._fleet.take_events():
            self._on_event(robot_id, event)
        for robot_id, link in self._fleet.links.items():
            # The page hears of a status first: its number is on the clock already.
            if link.poll(now_s):
                self._on_status(robot_id)
            stale = now_s - link.snapshot.received_s > STALE_S
            if stale is not self._stale.get(robot_id):
                self._stale[robot_id] = stale
                self._canvas.mark_stale(robot_id, stale)
        self._canvas.draw()
