"""Page client without a browser, and a site for it: robot, bus and dashboard server."""

from __future__ import annotations

import asyncio
import json
import socket
import threading
import time
from collections.abc import Callable, Coroutine, Generator, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

from websockets.asyncio import client as asyncio_client
from websockets.exceptions import ConnectionClosed, ConnectionClosedOK
from websockets.sync.client import ClientConnection, connect

from tests.support.robot_node import PATIENT
from tests.support.scene_doubles import EmptyScene
from tests.support.withheld import IN_PROCESS, PATIENCE_S, budget, this_thread_is_a_robot, wait_for
from tsd_twin import robots
from tsd_twin.bus import Bus, client_config, node_config
from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.dashboard.discovery import RobotDiscovery
from tsd_twin.dashboard.gateway.auth import AccessSettings, AuthMiddleware
from tsd_twin.dashboard.gateway.server import HttpServer
from tsd_twin.dashboard.recorded.pages import RecordedPages
from tsd_twin.dashboard.scene.client_views import SceneExecutor
from tsd_twin.dashboard.sessions.session_manager import SessionManager
from tsd_twin.dashboard.sessions.teleop import COMMAND_TIMEOUT_S
from tsd_twin.messages.events import Event
from tsd_twin.messages.services import Description
from tsd_twin.node import RobotNode
from tsd_twin.simulation import SimRobot

DRIVE_S = 0.02
BEATS = 5  # Heartbeat period in multiples of DRIVE_S.
_PUSHES = 5
T = TypeVar("T")


class _Socket(socket.socket):
    """Socket that drops messages after the server has closed, like a browser.

    With an error the client would end before it has read the server's close reason.
    """

    @classmethod
    def to(cls, port: int) -> _Socket:
        made = cls()
        made.connect(("127.0.0.1", port))
        return made

    def sendall(self, data: Any, flags: int = 0, /) -> None:
        with suppress(BrokenPipeError, ConnectionResetError):
            super().sendall(data, flags)


class Page:
    """Page client on a socket: sends heartbeats, and drive commands while a control is held."""

    def __init__(
        self,
        port: int,
        page: str,
        *,
        acknowledge: bool = True,
        user: str = "web",
        cookie: str | None = None,
        through: TlsConnection | None = None,
        recording: str = "",
    ) -> None:
        """Show `recording` if given; `through` is an open connection."""
        self.name = page
        self.operator = f"{user}-{page[:8]}"
        self.holds: dict[str, Any] | None = None
        self.beats = True
        self.focus = True
        self.messages: list[dict[str, Any]] = []
        self.closed: int | None = None
        self._newest: dict[str, dict[str, Any]] = {}
        self._acknowledge = acknowledge
        self._changed = threading.Condition()
        self._ended = threading.Event()
        self._sending = threading.Lock()
        self._socket: ClientConnection | TlsConnection = through or connect(
            f"ws://127.0.0.1:{port}/teleop?page={page}"
            + (f"&recording={recording}" if recording else ""),
            additional_headers=None if cookie is None else {"Cookie": cookie},
            sock=_Socket.to(port),
        )
        self._threads = [threading.Thread(target=work) for work in (self._read, self._beat)]
        for thread in self._threads:
            thread.start()

    def send(self, **message: Any) -> None:
        self._socket.send(json.dumps(message))

    def send_raw(self, frame: str | bytes) -> None:
        self._socket.send(frame)

    def send_together(self, data: bytes) -> None:
        """Send the raw frames `data` in one write, so that they arrive together."""
        assert isinstance(self._socket, ClientConnection)
        self._socket.socket.sendall(data)

    @property
    def close_reason(self) -> str | None:
        return self._socket.close_reason

    @property
    def state(self) -> dict[str, Any]:
        return self.last("state")

    @property
    def mode(self) -> str:
        return self.state["status"]["mode"]

    def last(self, kind: str) -> dict[str, Any]:
        return self._newest[kind]

    def all(self, kind: str) -> list[dict[str, Any]]:
        return [message for message in self.messages if message["t"] == kind]

    def until(self, condition: Callable[[], T]) -> T:
        """Wait until received messages make a condition true."""

        def holds() -> T | None:
            try:
                return condition()
            except (IndexError, KeyError):  # Not received yet.
                return None

        with self._changed:
            result = wait_for(self._changed, holds)
        assert result, f"it did not come; the last were {self.messages[-3:]}"
        return result

    def answer(self, to: str, **message: Any) -> dict[str, Any]:
        """Press a button and wait for the reply."""
        before = len(self.all("reply"))
        self.send(**message)
        return self.until(
            lambda: next(m for m in [*self.all("reply")[before:], {}] if m["to"] == to)
        )

    def take(self, *, take_over: bool = False, max_age_s: float | None = None) -> dict[str, Any]:
        wish = {"op": "acquire", "take_over": take_over, "max_age_s": max_age_s}
        return self.answer("lease", t="lease", **wish)

    def make_ready(self, max_age_s: float | None = None) -> None:
        """Take control and arm, from any state of the robot."""
        self.until(lambda: self.state)
        # Control may be reserved briefly for a page that has just closed.
        self.until(lambda: self.take(take_over=True, max_age_s=max_age_s)["ok"])
        self.until(lambda: self.state["has_control"])
        if self.mode in ("stopped", "fault"):
            self.until(lambda: self.answer("reset", t="reset")["ok"])
            self.until(lambda: self.mode == "disarmed")
        if self.mode == "disarmed":
            answer = self.answer("arm", t="arm")
            assert answer["ok"], answer
        self.until(lambda: self.mode in ("ready", "stopped", "fault"))
        assert self.mode == "ready", self.state["status"].get("stop")

    def drive(
        self,
        vx: float = 0.2,
        vy: float = 0.0,
        omega: float = 0.0,
        until: Callable[[], bool] | None = None,
    ) -> None:
        """Hold the stick until a condition is true, by default until the robot moves.

        The dashboard releases the controls of a page from which it hears nothing for
        `COMMAND_TIMEOUT_S`. If the machine withheld that time, the page pushes again.
        """
        done = until or (lambda: self.mode == "driving")
        for _ in range(_PUSHES):
            withheld, released = budget.watch(), len(self.all("released"))
            self.holds = {"vx": vx, "vy": vy, "omega": omega}
            self.until(
                lambda before=released: (
                    done()
                    or self.mode in ("stopped", "fault")
                    or len(self.all("released")) > before
                )
            )
            if done() or self.mode in ("stopped", "fault"):
                break
            assert withheld.total_s > COMMAND_TIMEOUT_S - DRIVE_S, self.last("released")
            self.let_go()
            self.until(lambda: self.mode not in ("driving", "stopping"))
            budget.repeated.append("hold the stick")
        assert done(), self.state["status"].get("stop")

    def let_go(self) -> None:
        """Release the stick, and send no more drive commands."""
        with self._sending:
            self.holds = None
            self.send(t="release")

    def close(self) -> None:
        self._ended.set()
        self._socket.close()
        for thread in self._threads:
            thread.join(PATIENCE_S)

    def _read(self) -> None:
        try:
            for frame in self._socket:
                message = json.loads(frame)
                with self._changed:
                    self.messages.append(message)
                    self._newest[message["t"]] = message
                    self._changed.notify_all()
        except ConnectionClosed:
            pass
        with self._changed:
            self.closed = self._socket.close_code
            self._changed.notify_all()

    def _beat(self) -> None:
        count = 0
        while not self._ended.wait(DRIVE_S):
            seen = self._newest.get("state", {}).get("status_seq", 0) if self._acknowledge else 0
            try:
                with self._sending:
                    if self.holds is not None:
                        self.send(**({"t": "drive", "status_seq": seen} | self.holds))
                if self.beats and count % BEATS == 0:
                    self.send(t="heartbeat", status_seq=seen, sent_ms=1.0, focus=self.focus)
            except ConnectionClosed:
                return
            count += 1


class Site:
    """Robots on a bus, and a dashboard server that shows them."""

    def __init__(
        self,
        bus: Bus,
        viser_port: int,
        auth: AuthMiddleware | None,
        page_scene: SceneExecutor | None = None,
        recordings: Path | None = None,
    ) -> None:
        nothing = EmptyScene()
        self.bus = bus
        self.discovery = RobotDiscovery(bus)
        self._loop = asyncio.new_event_loop()
        self._ended = threading.Event()
        self._deaf = threading.Event()
        self.sessions = SessionManager(self.discovery.links, page_scene or nothing)
        self.discovery.on_change = self.sessions.on_robots_changed
        auth = auth or AuthMiddleware(AccessSettings(allowed_hosts=["robot.example"]))
        recorded = RecordedPages(recordings, self.sessions.live) if recordings else None
        self.gateway = HttpServer(self.sessions, viser_port, auth=auth, recorded=recorded)
        self._threads = [
            threading.Thread(target=self._loop.run_forever),
            threading.Thread(target=self._poll),
        ]
        for thread in self._threads:
            thread.start()
        self.run(self.gateway.start(port=0))

    @property
    def port(self) -> int:
        return self.gateway.port

    @property
    def link(self) -> RobotMonitor:
        return next(iter(self.discovery.links.values()))

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine on the gateway's loop and return its result."""
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(PATIENCE_S)

    def choose(self, page: str, *robot_ids: str) -> None:
        """Select robots in a page, without pauses."""

        def choose() -> None:
            for robot_id in robot_ids:
                self.sessions.select_robot(page, robot_id)

        self._loop.call_soon_threadsafe(choose)

    def repeat_status(self) -> None:
        """Handle the latest status of each robot again, like a late loop."""
        for robot_id in self.discovery.links:
            self._loop.call_soon_threadsafe(self.sessions.on_status, robot_id)

    def tell(self, robot_id: str, event: Event) -> None:
        self._loop.call_soon_threadsafe(self.sessions.on_event, robot_id, event)

    @contextmanager
    def page(self, page: str = "0123456789abcdef", **options: Any) -> Generator[Page]:
        opened = Page(self.port, page, **options)
        try:
            yield opened
        finally:
            opened.close()

    def deafen(self) -> None:
        """Drop all further messages of all robots."""
        self._deaf.set()

    def close(self) -> None:
        self.run(self.gateway.stop())
        self._ended.set()
        self._loop.call_soon_threadsafe(self._loop.stop)
        for thread in self._threads:
            thread.join(PATIENCE_S)
        self._loop.close()

    def _poll(self) -> None:
        while not self._ended.wait(1.0 / 60.0):
            if self._deaf.is_set():
                continue
            self.discovery.refresh()
            for robot_id, event in self.discovery.take_events():
                self.tell(robot_id, event)
            for robot_id, link in self.discovery.links.items():
                if link.poll(time.monotonic()):
                    self._loop.call_soon_threadsafe(self.sessions.on_status, robot_id)


@contextmanager
def robot_on_a_bus(robot_id: str = "tsd") -> Generator[str]:
    """Run a simulated robot that arms at once; yield its endpoint."""
    text = PATIENT.replace("arming_hold_s = 0.1", "arming_hold_s = 0.0", 1)
    robot = robots.parse_description(text, "tsd")
    stop = threading.Event()
    with Bus(node_config(["tcp/127.0.0.1:0"])) as bus:
        node = RobotNode(bus, robot_id, robot, SimRobot(robot), Description(text, ""))

        def run() -> None:
            this_thread_is_a_robot()
            node.run(stop)

        thread = threading.Thread(target=run)
        thread.start()
        followed = budget.follow(IN_PROCESS)
        try:
            yield bus.endpoints()[0]
        finally:
            followed.end()
            stop.set()
            thread.join(PATIENCE_S)


@contextmanager
def site(
    viser_port: int = 1,
    auth: AuthMiddleware | None = None,
    page_scene: SceneExecutor | None = None,
    recordings: Path | None = None,
) -> Generator[Site]:
    """Run a robot and a gateway without a scene, and without viser unless a port is given."""
    with robot_on_a_bus() as endpoint, Bus(client_config([endpoint])) as bus:
        made = Site(bus, viser_port, auth, page_scene, recordings)
        try:
            yield made
        finally:
            made.close()


class TlsConnection:
    """Open WebSocket over TLS for blocking code, with the methods that a `Page` uses.

    `tls_connection` creates it. The asyncio client runs on another thread.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, url: str, options: dict[str, Any]) -> None:
        self._loop = loop
        self._connection = self._run(_opened(url, options))

    def send(self, message: str | bytes) -> None:
        self._run(self._connection.send(message))

    def __iter__(self) -> Iterator[str | bytes]:
        with suppress(ConnectionClosedOK):
            while True:
                yield self._run(self._connection.recv())

    def close(self) -> None:
        self._run(self._connection.close())

    @property
    def close_code(self) -> int | None:
        return self._connection.close_code

    @property
    def close_reason(self) -> str | None:
        return self._connection.close_reason

    def _run(self, work: Coroutine[Any, Any, T]) -> T:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()


async def _opened(url: str, options: dict[str, Any]) -> asyncio_client.ClientConnection:
    return await asyncio_client.connect(url, **options)


@contextmanager
def tls_connection(url: str, **options: Any) -> Generator[TlsConnection]:
    """Yield an open WebSocket; `options` are arguments of the asyncio client of `websockets`.

    The synchronous client reads and writes a TLS connection on two threads. On a busy machine,
    one of 200 handshakes with any server never ends.
    """
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()
    try:
        connection = TlsConnection(loop, url, options)
        try:
            yield connection
        finally:
            connection.close()
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()
