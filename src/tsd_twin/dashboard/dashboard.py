"""Dashboard process: robot discovery, scene, panels and HTTP server, and the update loop."""

from __future__ import annotations

import asyncio
import ctypes
import logging
import math
import sys
import threading
import time
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path
from typing import Protocol, TypeVar

from tsd_twin.bus import Bus
from tsd_twin.client.connection import RobotMonitor, Snapshot
from tsd_twin.dashboard import viser_compat
from tsd_twin.dashboard.robot_discovery import RobotDiscovery
from tsd_twin.dashboard.scene.appearance import RobotRoster, ViewSettings
from tsd_twin.dashboard.scene.panel_manager import PanelManager
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.server.auth import AccessSettings, AuthMiddleware
from tsd_twin.dashboard.server.http_server import HttpServer
from tsd_twin.dashboard.server.recorded_pages import RecordedPages
from tsd_twin.dashboard.server.session_manager import SessionManager
from tsd_twin.lie import Array
from tsd_twin.messages.requests import Event

_M_MMAP_THRESHOLD = -3
"""From glibc's `malloc.h`."""
_MMAP_THRESHOLD_BYTES = 65536


def tune_malloc() -> bool:
    """Let glibc give blocks of 64 KiB and more back to the system as soon as they are freed.

    Each page that opens makes the dashboard take and free many of them. glibc raises its own bound
    between heap and maps, up to 32 MiB, to the size of whatever is freed; blocks below it then come
    from heaps of many threads, in the holes between what stays, and a day of visits leaves a
    fragmented heap that is never returned. A bound that is set is not raised.

    Returns:
        Whether the C library took it; one that is not glibc needs none of this.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    return mallopt is not None and mallopt(_M_MMAP_THRESHOLD, _MMAP_THRESHOLD_BYTES) == 1


_WORKER_LOG = logging.getLogger(__name__)
_Answer = TypeVar("_Answer")


class BackgroundWorker:
    """Worker thread with a queue of tasks; thread-safe."""

    def __init__(self, name: str) -> None:
        self._pool = ThreadPoolExecutor(1, name)
        self._lock = threading.Lock()
        self._waiting: dict[Hashable, Callable[[], None]] = {}

    @property
    def waiting(self) -> int:
        """Number of tasks that wait under a key."""
        with self._lock:
            return len(self._waiting)

    def submit_latest(self, key: Hashable, work: Callable[[], None]) -> None:
        """Queue `work`; it replaces a waiting task with the same key."""
        with self._lock:
            waits = key in self._waiting
            self._waiting[key] = work
            if not waits:
                self._pool.submit(self._do, key)

    def submit(self, work: Callable[[], _Answer]) -> Future[_Answer]:
        """Queue `work`, and return its future result."""
        return self._pool.submit(work)

    def close(self) -> None:
        """Finish queued tasks, and accept no more."""
        self._pool.shutdown()

    def _do(self, key: Hashable) -> None:
        with self._lock:
            work = self._waiting.pop(key)
        try:
            work()
        except Exception:  # The next task belongs to another page.
            _WORKER_LOG.exception("%s was not done", key)


_LOG = logging.getLogger(__name__)

RATE_HZ = 60.0
STALE_S = 0.3
"""An older state must not look live."""
IDLE_PERIOD_S = 0.2
"""Time between two polls of the statuses while no page is open."""
LINGER_S = 10.0
"""The picture goes on for so long after the last page has closed: a page that reloads finds it."""


class RobotDisplay(Protocol):
    """Interface of a display of robots, such as the scene."""

    def add(self, link: RobotMonitor) -> None:
        """Add a robot."""
        ...

    def draw(self) -> None:
        """Draw all changes."""
        ...

    def set_stale(self, robot_id: str, stale: bool) -> None:
        """Show a robot as stale, or as live."""
        ...


class UpdateLoop:
    """Polls all robots on a thread of its own: at 60 Hz while it is watched, else five times a
    second and their statuses only.
    """

    def __init__(
        self,
        discovery: RobotDiscovery,
        display: RobotDisplay,
        on_status: Callable[[str], None],
        on_event: Callable[[str, Event], None],
        is_watched: Callable[[], bool] = lambda: True,
    ) -> None:
        """`on_status` and `on_event` are called on the thread of the loop and must not block.

        `is_watched` says whether a page is open; call `wake` when one opens.
        """
        self._discovery = discovery
        self._display = display
        self._on_status = on_status
        self._on_event = on_event
        self._is_watched = is_watched
        self._watched_s = -math.inf
        self._active = False
        self._wake = threading.Event()
        self._stale: dict[str, bool] = {}

    def wake(self) -> None:
        """Look at once whether a page is open, or whether to end; from any thread."""
        self._wake.set()

    def run(self, stop: threading.Event) -> None:
        """Run until `stop` is set."""
        # New meshes take a second to draw: robots already shown are polled meanwhile.
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

    def _add(self, link: RobotMonitor) -> None:
        try:
            self._display.add(link)
        except Exception:  # Descriptions come from the bus; the others are drawn all the same.
            _LOG.exception("robot %s cannot be drawn", link.id)
        self._stale.pop(link.id, None)  # A new robot in the scene looks live.

    def _tick(self, now_s: float, drawing: Executor) -> None:
        if self._is_watched():
            self._watched_s = now_s
        self._active = now_s - self._watched_s < LINGER_S
        for robot_id in self._discovery.refresh():
            drawing.submit(self._add, self._discovery.links[robot_id])
        for robot_id, event in self._discovery.take_events():
            self._on_event(robot_id, event)
        for robot_id, link in self._discovery.links.items():
            link.set_streaming(self._active)
            # Pages receive a status before the scene does: its number is already in use for
            # commands.
            before = link.snapshot
            news = link.poll(now_s)
            if news or (before.odom is None and link.snapshot.odom is not None):
                self._on_status(robot_id)  # Also with the first pose: a page waits for it.
            if not self._active:
                continue
            stale = now_s - link.snapshot.received_s > STALE_S
            if stale is not self._stale.get(robot_id):
                self._stale[robot_id] = stale
                self._display.set_stale(robot_id, stale)
        if self._active:
            self._display.draw()


TITLE = "tsd-twin"
_STOP_POLL_S = 0.2
_SWITCH_S = 0.001
"""A busy thread keeps the others waiting for so long; a stop passes through four of them."""


async def run(
    bus: Bus,
    host: str,
    port: int,
    stop: threading.Event,
    on_ready: Callable[[int], None],
    rules: AccessSettings,
    first: Sequence[str] = (),
    recordings: Path | None = None,
) -> None:
    """Serve the page until `stop` is set; `on_ready` is called with the port.

    `recordings` is a folder whose recordings pages may show.

    `rules` are the access settings; `first` are ids of the robots that come first in the menu.

    Raises:
        TwinError: the address cannot be used, or not with these rules.
    """
    rules.check(host)
    sys.setswitchinterval(_SWITCH_S)
    loop = asyncio.get_running_loop()
    discovery = RobotDiscovery(bus)
    # Panels wait for a frame to be drawn; the event loop that forwards commands must not.
    worker = BackgroundWorker("panels")

    def on_released(page: str) -> None:
        worker.submit_latest(("reset", page), lambda: panels.reset_sliders(page))

    def on_chosen(page: str, robot_id: str) -> None:
        worker.submit_latest(("choose", page), lambda: panels.select_robot(page, robot_id))

    server = viser_compat.start_server(TITLE)
    try:
        roster = RobotRoster(first)
        scene = Scene(server, roster)
        # The two know each other by callbacks only: neither waits for the other's thread.
        scene_executor = SceneExecutor(worker, scene, lambda: panels)
        sessions = SessionManager(
            discovery,
            on_released,
            on_chosen,
            scene_executor,
            on_opened=lambda: ticker.wake(),
            roster=roster,
        )
        gateway = HttpServer(
            sessions,
            server.get_port(),
            auth=AuthMiddleware(rules),
            recorded=RecordedPages(recordings, sessions.stop_all) if recordings else None,
        )
        panels = PanelManager(
            server,
            scene,
            sessions.on_panel,
            sessions.select_robot,
            sessions.on_sphere_click,
            robot_of=sessions.robot_of,
            on_view=sessions.on_view,
            view_of=sessions.view_of,
        )
        scene.on_trails_cleared = sessions.on_trails_cleared

        def on_status(robot_id: str) -> None:
            loop.call_soon_threadsafe(sessions.on_status, robot_id)

        def on_event(robot_id: str, event: Event) -> None:
            loop.call_soon_threadsafe(sessions.on_event, robot_id, event)

        async def on_client(_client: object) -> None:
            ticker.wake()

        ended = threading.Event()
        ticker = UpdateLoop(
            discovery,
            scene,
            on_status,
            on_event,
            is_watched=lambda: sessions.any_open or bool(server.get_clients()),
        )
        server.on_client_connect(on_client)
        await gateway.start(host, port)
        thread = threading.Thread(target=ticker.run, args=(ended,), name="ticker")
        thread.start()
        try:
            on_ready(gateway.port)
            while not stop.is_set():  # Set by a signal handler, which cannot wake a loop safely.
                await asyncio.sleep(_STOP_POLL_S)
        finally:
            await gateway.stop()
            ended.set()
            ticker.wake()
            await asyncio.to_thread(thread.join)
    finally:
        worker.close()
        server.stop()


class SceneExecutor:
    """Scene operations of pages, run one after the other on a thread off the event loop."""

    def __init__(
        self, worker: BackgroundWorker, scene: Scene, panels: Callable[[], PanelManager]
    ) -> None:
        self._worker, self._scene, self._panels = worker, scene, panels

    def pick_floor(self, page: str, shares: Array) -> Future[Array]:
        """Floor points (m, 2) in `odom` at screen positions `shares` of a page."""
        return self._worker.submit(lambda: self._panels().pick_floor(page, shares))

    def show_route(self, robot_id: str, poses: Array | None) -> None:
        """Show the planned path of a robot on all pages; None removes it."""
        self._worker.submit_latest(
            ("route", robot_id), lambda: self._scene.show_route(robot_id, poses)
        )

    def apply_view(self, page: str, settings: ViewSettings, *, look: bool) -> None:
        """Apply the view settings of a page; `look` turns its camera to the robot."""
        self._worker.submit_latest(
            ("view", page), lambda: self._panels().set_view(page, settings, look=look)
        )

    def show_past(self, page: str, past: Snapshot | None, ago_s: float) -> None:
        """Draw the robot of a page as it was some seconds ago, beside the live one, or no more."""
        self._worker.submit_latest(
            ("past", page), lambda: self._panels().show_past(page, past, ago_s)
        )

    def envelope(self, robot_id: str) -> Array | None:
        """Drawn stop envelope (n, 2) in the frame of a robot; None at rest."""
        return self._scene.envelope(robot_id)

    def reach_m(self, robot_id: str) -> float:
        """Radius of a robot around its base; 0 while it is not in the scene."""
        return self._scene.reach_m(robot_id)
