"""The dashboard: bus, scene, panels and gateway, put together."""

from __future__ import annotations

import asyncio
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future

from tsd_twin.bus import Bus
from tsd_twin.dashboard import viser_server
from tsd_twin.dashboard.audience import Audience
from tsd_twin.dashboard.chores import Chores
from tsd_twin.dashboard.door import Door, Rules
from tsd_twin.dashboard.fleet import Fleet
from tsd_twin.dashboard.gateway import Gateway
from tsd_twin.dashboard.panels import Panels
from tsd_twin.dashboard.scene import Scene
from tsd_twin.dashboard.ticker import Ticker
from tsd_twin.lie import Array
from tsd_twin.messages.service import Event

TITLE = "tsd-twin"
_LOOK_FOR_STOP_S = 0.2
_SWITCH_S = 0.001
"""A busy thread keeps the others waiting for so long; a stop passes through four of them."""


async def run(
    bus: Bus,
    host: str,
    port: int,
    stop: threading.Event,
    on_ready: Callable[[int], None],
    rules: Rules,
) -> None:
    """Serve the page until `stop` is set; `on_ready` is called with the port.

    `rules` say who may come in.

    Raises:
        TwinError: the address cannot be used, or not with these rules.
    """
    rules.check(host)
    sys.setswitchinterval(_SWITCH_S)
    loop = asyncio.get_running_loop()
    fleet = Fleet(bus)
    # Panels wait for a frame to be drawn; the loop between fingers and robots must not.
    chores = Chores("panels")

    def on_released(page: str) -> None:
        chores.soon(("reset", page), lambda: panels.reset(page))

    def on_chosen(page: str, robot_id: str) -> None:
        chores.soon(("choose", page), lambda: panels.choose(page, robot_id))

    server = viser_server.start(TITLE)
    try:
        scene = Scene(server)
        # The two know each other by callbacks only: neither waits for the other's thread.
        easel = _Easel(chores, scene, lambda: panels)
        audience = Audience(fleet, on_released, on_chosen, easel)
        gateway = Gateway(audience, server.get_port(), door=Door(rules))
        panels = Panels(
            server,
            scene,
            audience.panel,
            audience.choose,
            audience.point,
            robot_of=audience.robot_of,
        )

        def on_status(robot_id: str) -> None:
            loop.call_soon_threadsafe(audience.on_status, robot_id)

        def on_event(robot_id: str, event: Event) -> None:
            loop.call_soon_threadsafe(audience.on_event, robot_id, event)

        await gateway.start(host, port)
        ended = threading.Event()
        ticker = Ticker(fleet, scene, on_status, on_event)
        thread = threading.Thread(target=ticker.run, args=(ended,), name="ticker")
        thread.start()
        try:
            on_ready(gateway.port)
            while not stop.is_set():  # Set by a signal handler, which cannot wake a loop safely.
                await asyncio.sleep(_LOOK_FOR_STOP_S)
        finally:
            await gateway.stop()
            ended.set()
            await asyncio.to_thread(thread.join)
    finally:
        chores.close()
        server.stop()


class _Easel:
    """The scene and its panels, as pages draw on them: done in turn, off the event loop."""

    def __init__(self, chores: Chores, scene: Scene, panels: Callable[[], Panels]) -> None:
        self._chores, self._scene, self._panels = chores, scene, panels

    def floor(self, page: str, shares: Array) -> Future[Array]:
        """Return the places (m, 2) in `odom` that the picture of a page shows at `shares`."""
        return self._chores.submit(lambda: self._panels().floor(page, shares))

    def show_route(self, robot_id: str, poses: Array | None) -> None:
        """Show everybody where a robot is planned to go; None: nowhere."""
        self._chores.soon(("route", robot_id), lambda: self._scene.show_route(robot_id, poses))
