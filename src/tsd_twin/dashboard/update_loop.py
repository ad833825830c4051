"""Update loop of the scene."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor

from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.dashboard.discovery import RobotDiscovery
from tsd_twin.dashboard.scene.scene import STALE_S, Scene
from tsd_twin.messages.events import Event
from tsd_twin.messages.modes import ARMED

_LOG = logging.getLogger(__name__)

RATE_HZ = 60.0
IDLE_PERIOD_S = 0.2
"""Time between two polls of the summaries while no page is open."""
IDLE_TIMEOUT_S = 10.0
"""Time for which the scene is drawn after the last page has closed, and a robot is followed after
it was last shown or driven; a page that reloads continues with them."""


class UpdateLoop:
    """Polls all robots on a separate thread: at 60 Hz while it is watched, else at 5 Hz.

    While it is watched, robots that are shown or driven send all streams; all others send two
    summaries a second.
    """

    def __init__(
        self,
        discovery: RobotDiscovery,
        scene: Scene,
        on_status: Callable[[str], object],
        on_event: Callable[[str, Event], object],
        is_watched: Callable[[], bool] = lambda: True,
        is_shown: Callable[[str], bool] = lambda _robot: True,
    ) -> None:
        """`on_status` and `on_event` are called on the thread of the loop and must not block.

        `is_watched` returns whether a page is open, `is_shown` whether one has a robot selected;
        call `wake` when one opens.
        """
        self._discovery = discovery
        self._scene = scene
        self._on_status = on_status
        self._on_event = on_event
        self._is_watched, self._is_shown = is_watched, is_shown
        self._watched_s = -math.inf
        self._active = False
        self._wake = threading.Event()
        self._new: deque[RobotMonitor] = deque()
        self._stale: dict[str, bool] = {}
        self._followed_s: dict[str, float] = {}

    def wake(self) -> None:
        """Look at once whether a page is open, or whether to end; from any thread."""
        self._wake.set()

    def run(self, stop: threading.Event) -> None:
        """Run until `stop` is set."""
        # New meshes take a second to draw; the other robots are polled during that time.
        with ThreadPoolExecutor(1, "canvas") as drawing:
            while not stop.is_set():
                if self._active:
                    stop.wait(1.0 / RATE_HZ)
                else:
                    self._wake.wait(IDLE_PERIOD_S)
                    self._wake.clear()
                try:
                    self._tick(time.monotonic(), drawing)
                except Exception:  # A frame that fails must not end the display for all pages.
                    _LOG.exception("a frame was lost")
            drawing.shutdown(wait=False, cancel_futures=True)

    def _add_new(self) -> None:
        """Add the robots that wait to the scene, with one update of the views of all clients."""
        links: list[RobotMonitor] = []
        while self._new:
            links.append(self._new.popleft())
        if not links:
            return
        with self._scene.one_update():
            for link in links:
                try:
                    self._scene.add(link)
                except Exception:  # Descriptions come from the bus; the others are drawn.
                    _LOG.exception("robot %s cannot be drawn", link.id)
                self._stale.pop(link.id, None)  # A new robot in the scene looks live.

    def _is_followed(self, link: RobotMonitor, now_s: float) -> bool:
        """Return whether a robot is or was recently shown or driven.

        A summary follows each change of mode at once, so that a robot is followed before it moves.
        """
        status = link.snapshot.status
        driven = status is not None and (status.lease.holder is not None or status.mode in ARMED)
        if driven or self._is_shown(link.id):
            self._followed_s[link.id] = now_s
        return now_s - self._followed_s.get(link.id, -math.inf) < IDLE_TIMEOUT_S

    def _tick(self, now_s: float, drawing: Executor) -> None:
        if self._is_watched():
            self._watched_s = now_s
        self._active = now_s - self._watched_s < IDLE_TIMEOUT_S
        for robot_id in self._discovery.refresh():
            self._new.append(self._discovery.links[robot_id])
            drawing.submit(self._add_new)
        for robot_id, event in self._discovery.take_events():
            self._on_event(robot_id, event)
        for robot_id, link in self._discovery.links.items():
            link.set_streaming(self._active and self._is_followed(link, now_s))
            # Pages receive a status before the scene does: its number is already in use for
            # commands.
            if link.poll(now_s):
                self._on_status(robot_id)
        # Viewers that connect hold the lock; a driver's states must not wait for them.
        if self._active and self._scene.lock.acquire(timeout=1.0 / RATE_HZ):
            try:
                self._draw(now_s)
            finally:
                self._scene.lock.release()

    def _draw(self, now_s: float) -> None:
        for robot_id, link in self._discovery.links.items():
            stale = link.snapshot.overdue_s(now_s) > STALE_S
            if stale is not self._stale.get(robot_id):
                self._stale[robot_id] = stale
                self._scene.set_stale(robot_id, stale)
        self._scene.draw()
