"""Dashboard process: wiring of robot discovery, scene, views, HTTP server and update loop."""

from __future__ import annotations

import asyncio
import sys
import threading
from collections.abc import Callable, Coroutine, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from tsd_twin.bus import Bus
from tsd_twin.dashboard.discovery import RobotDiscovery
from tsd_twin.dashboard.gateway.auth import AccessSettings, AuthMiddleware
from tsd_twin.dashboard.gateway.server import HttpServer
from tsd_twin.dashboard.ground_layer import GroundLayer
from tsd_twin.dashboard.pictures.feed import Cameras
from tsd_twin.dashboard.recorded.pages import RecordedPages
from tsd_twin.dashboard.scene import viser_compat
from tsd_twin.dashboard.scene.appearance import RobotRoster
from tsd_twin.dashboard.scene.client_views import BackgroundWorker, ClientViews, SceneExecutor
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.sessions.session_manager import SessionManager
from tsd_twin.dashboard.update_loop import UpdateLoop

TITLE = "tsd-twin"
_STOP_POLL_S = 0.2
_SWITCH_S = 0.001
"""Time slice of a busy thread, for which others wait; a stop passes through four threads."""


async def run(
    bus: Bus,
    host: str,
    port: int,
    stop: threading.Event,
    on_ready: Callable[[int], None],
    rules: AccessSettings,
    first: Sequence[str] = (),
    recordings: Path | None = None,
    viewport_port: int | None = None,
    open_pictures: Callable[[], Bus] | None = None,
) -> None:
    """Serve the page until `stop` is set; `on_ready` is called with the port.

    `recordings` is a folder whose recordings pages may show; `viewport_port` is the port of the
    viewport, by default the next one; `open_pictures` opens a session on the bus for pictures of
    cameras, which pages show then.

    `rules` are the access settings; `first` are ids of the robots that come first in the menu.

    Raises:
        TwinError: If the address cannot be used, or not with these rules.
    """
    rules.check(host)
    sys.setswitchinterval(_SWITCH_S)
    loop = asyncio.get_running_loop()
    discovery = RobotDiscovery(bus)
    # Views wait for a frame to be drawn; the event loop that forwards commands must not.
    worker = BackgroundWorker("views")

    server = viser_compat.start_server(TITLE)
    try:
        roster = RobotRoster(first)
        scene = Scene(server, roster, separate=rules.limits_robots)
        # The two know each other by callbacks only: neither waits for the other's thread.
        sessions = SessionManager(
            discovery.links,
            SceneExecutor(worker, scene, lambda: views),
            on_opened=lambda: ticker.wake(),
            roster=roster,
        )
        cameras = Cameras(bus, open_pictures) if open_pictures else None
        gateway = HttpServer(
            sessions,
            server.get_port(),
            auth=AuthMiddleware(rules),
            recorded=RecordedPages(recordings, sessions.live) if recordings else None,
            cameras=cameras,
        )
        views = ClientViews(
            server,
            scene,
            sessions.on_sphere_click,
            view_of=sessions.view_of,
        )
        discovery.on_change = sessions.on_robots_changed

        async def on_client(_client: object) -> None:
            ticker.wake()

        ticker = UpdateLoop(
            discovery,
            scene,
            partial(loop.call_soon_threadsafe, sessions.on_status),
            partial(loop.call_soon_threadsafe, sessions.on_event),
            is_watched=lambda: sessions.any_open or bool(server.get_clients()),
            is_shown=sessions.is_shown,
        )
        server.on_client_connect(on_client)
        await gateway.start(host, port, viewport_port)
        ground = cameras and GroundLayer(cameras, views, worker).run()
        await _serve_until(stop, gateway, ticker, on_ready, ground)
    finally:
        worker.close()
        server.stop()


async def _serve_until(
    stop: threading.Event,
    gateway: HttpServer,
    ticker: UpdateLoop,
    on_ready: Callable[[int], None],
    ground: Coroutine[Any, Any, None] | None,
) -> None:
    """Draw on another thread, and answer requests here, until `stop` is set."""
    ended = threading.Event()
    thread = threading.Thread(target=ticker.run, args=(ended,), name="ticker")
    thread.start()
    drawing = ground and asyncio.create_task(ground)
    try:
        on_ready(gateway.port)
        while not stop.is_set():  # Set by a signal handler, which cannot wake a loop safely.
            await asyncio.sleep(_STOP_POLL_S)
    finally:
        if drawing:
            drawing.cancel()
            await asyncio.gather(drawing, return_exceptions=True)
        await gateway.stop()
        ended.set()
        ticker.wake()
        await asyncio.to_thread(thread.join)
