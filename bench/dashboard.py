"""Dashboard with viewers, compared with a plain viser server; and a fleet, with one robot."""

from __future__ import annotations

import multiprocessing as mp
import secrets
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from multiprocessing.connection import Connection
from typing import cast

import msgspec
import numpy as np
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from bench.bus import paced_speeds, watch_setpoint
from bench.programs import Load, counter, dashboard, mock, peer, program, python
from bench.table import Row, Run, percentile, quantiles
from tests.support.page_client import Page
from tests.support.scene_doubles import RobotFeed
from tests.support.viser_client import CAMERA, decoded
from tsd_twin.bus import Bus, client_config
from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.dashboard.scene import viser_compat
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.update_loop import RATE_HZ
from tsd_twin.messages.modes import LATCHED

_STEP_M = 0.01
_ROUNDS = 3
_FLEET = 20
_SCENE_KB_S, _ADDED_MS = 400.0, 5.0
"""Limits with this many robots and viewers; the last one in excess of a single robot."""
PROTOCOL = Subprotocol("viser-v1.1.1")


def rows(run: Run) -> Iterator[Row]:
    """Measure the processes with a robot that drives, then the delay from a pose to the socket.

    The plain server moves as many nodes as often as the dashboard does for one viewer.
    """
    seconds = run.pick(2.0, 1.0)
    names = ["dashboard.cpu_1", "dashboard.cpu_20", "dashboard.bytes"]
    if run.wants(*names):
        sent = driven(1, seconds)[1]
        hz = sent["frames_hz"]
        plain = plain_server(sent["moves_hz"] / hz, hz)
        with plain as url:
            note = f"{sent['moves_hz']:.0f} moves in {hz:.0f} frames a second"
            for viewers, rows_of in ((1, names[:1]), (20, names[1:])):

                def subject(viewers: int = viewers) -> tuple[float, float]:
                    load, received = driven(viewers, seconds)
                    return load, received["scene_kB_s"]

                def bare(viewers: int = viewers) -> tuple[float, float]:
                    load, received = watched(plain, url, viewers, seconds, "scene")
                    return load, received["scene_kB_s"]

                yield from run.alternate(
                    rows_of, subject, bare, rounds=_ROUNDS, note=partial(str, note)
                )
    if run.wants("dashboard.delay_p50", "dashboard.delay_p90"):
        yield from delays(run)
    yield from fleet(run)


def plain_server(messages: float, hz: float) -> program:
    """Return a plain viser server with frames of so many messages, two for each moved node."""
    return peer("viser", str(round(messages / 2.0)), str(hz))


def driven(viewers: int, seconds: float) -> tuple[float, dict[str, float]]:
    """Return the CPU load of a dashboard, ms/s, and the data that each viewer receives."""
    with mock() as endpoint:
        served = dashboard(endpoint)
        with served as url:
            return watched(served, url, viewers, seconds, "drive")


def watched(
    server: program, url: str, viewers: int, seconds: float, what: str
) -> tuple[float, dict[str, float]]:
    """Return the CPU load of a server with viewers, ms/s, and the data that each receives."""
    watching = viewers_of(url, viewers, what)
    with watching:
        return loaded(server, watching, lambda: time.sleep(seconds))


def viewers_of(url: str, viewers: int, what: str) -> counter:
    """Return a process with viewers of a server."""
    return counter(python("bench.viewers", url, str(viewers), what))


def loaded(
    server: program, watching: counter, act: Callable[[], object]
) -> tuple[float, dict[str, float]]:
    """Return the CPU load of a server, ms/s, and the data of its viewers, while `act` runs."""
    load = Load(server)

    def measured() -> None:
        with load:
            act()

    received = watching.during(measured)
    return load.ms_per_s, received


def fleet(run: Run) -> Iterator[Row]:
    """Drive five of twenty robots, each shown to a viewer.

    The peers are a plain viser server that sends frames of as many messages at 60 Hz to as many
    viewers, the requirement, and a single robot.
    """
    count = int(run.pick(_FLEET, 3))
    commands, seconds = int(run.pick(300, 20)), run.pick(6.0, 0.6)
    sent: list[dict[str, float]] = []

    def measure(robots: int) -> tuple[float, dict[str, float], float]:
        times_ms: list[float] = []
        with ExitStack() as stack:
            # A separate process, because robots in one process delay each other.
            endpoints = [stack.enter_context(mock("--id", "lab0"))]
            if robots > 1:
                others = mock("--id", "lab", "--count", str(robots - 1))
                endpoints += ["--connect", stack.enter_context(others)]
            served = dashboard(*endpoints)
            url = stack.enter_context(served)
            # Take control last, because viewers that connect delay everybody.
            watching = viewers_of(url, robots, "fleet")
            stack.enter_context(watching)
            delays_ms = stack.enter_context(stick(url, endpoints[0]))
            push = partial(delays_ms, commands)
            load, received = loaded(served, watching, lambda: times_ms.extend(push()))
        return load, received, percentile(times_ms, 0.99)

    def subject() -> tuple[float, float, float]:
        load, received, p99_ms = measure(count)
        sent.append(received)
        return load, received["scene_kB_s"], p99_ms

    def bare() -> tuple[float, float, float]:
        plain = plain_server(sent[-1]["messages_hz"] / sent[-1]["frames_hz"], RATE_HZ)
        with plain as url:
            load = watched(plain, url, count, seconds, "scene")[0]
        return load, _SCENE_KB_S, measure(1)[2] + _ADDED_MS

    def note() -> str:
        hz, driving = (min(each[key] for each in sent) for key in ("frames_hz", "driving"))
        return f"{hz:.0f} frames a second, robots driving {100 * driving:.0f} % of the time"

    yield from run.alternate(
        ["dashboard.fleet_cpu", "dashboard.fleet_bytes", "dashboard.fleet_delay"],
        subject,
        bare,
        rounds=_ROUNDS,
        note=note,
    )


@contextmanager
def stick(url: str, endpoint: str) -> Generator[Callable[[int], list[float]]]:
    """Take control of lab0 on a page; yield a function that returns delays to the setpoint, ms."""
    with Bus(client_config([endpoint])) as bus:
        came = watch_setpoint(bus, "lab0")
        answered = [0]
        page = Page(int(url.rstrip("/").rpartition(":")[2]), secrets.token_hex(8))

        def push(vx_mps: float) -> None:
            status = page.state["status"]
            if status["mode"] in LATCHED or not page.state["has_control"]:
                raise RuntimeError(f"lab0 cannot be driven: {page.mode}, {status.get('stop')}")
            if len(page.all("released")) > answered[0]:  # After a stall the stick springs back.
                answered[0] = len(page.all("released"))
                page.send(t="release")
            state = page.state["status_seq"]
            page.send(t="drive", vx=vx_mps, vy=0.0, omega=0.0, status_seq=state)

        try:
            page.until(lambda: any(each["id"] == "lab0" for each in page.last("welcome")["robots"]))
            page.send(t="robot", id="lab0")
            page.until(lambda: page.last("robot")["id"] == "lab0")
            page.make_ready()
            yield partial(paced_speeds, push, came)
            page.let_go()
        finally:
            page.close()


def delays(run: Run) -> Iterator[Row]:
    """Compare the scene with a single bare node of viser, at 60 Hz."""
    frames = int(run.pick(120, 30))
    server = viser_compat.start_server("bench")
    try:
        bare = server.scene.add_frame("/bare", show_axes=False)

        def move_bare(x: float) -> None:
            bare.position = (x, 0.0, 0.0)
            server.flush()

        feed, scene = RobotFeed(), Scene(server)
        feed.say(pose=np.zeros(3), joints=feed.kinematics.inverse(np.zeros(3)))
        scene.add(cast(RobotMonitor, feed))

        def move_robot(x: float) -> None:
            joints = feed.kinematics.inverse(np.array([0.5, 0.2 * np.sin(x), 0.4]))
            pose = np.array([-x, 0.0, 0.5 * x])
            feed.say(pose=pose, joints=joints, setpoint=joints, truth=pose + 0.01)
            scene.draw()

        port = server.get_port()
        yield from run.alternate(
            ["dashboard.delay_p50", "dashboard.delay_p90"],
            lambda: quantiles(timed(port, "/w", move_robot, frames)),
            lambda: quantiles(timed(port, "/bare", move_bare, frames)),
            rounds=_ROUNDS,
        )
    finally:
        server.stop()


def timed(port: int, node: str, move: Callable[[float], None], frames: int) -> list[float]:
    """Return the latencies of new positions to a socket in another process, ms."""
    spawn = mp.get_context("spawn")
    ours, theirs = spawn.Pipe()
    reader = spawn.Process(target=receive, args=(port, viser_compat.access_key(), node, theirs))
    reader.start()
    ours.recv()
    set_s: dict[int, float] = {}
    for step in range(1, frames + 1):
        set_s[step] = time.monotonic()
        move(step * _STEP_M)
        time.sleep(1 / 60)
    ours.send("enough")
    got_s: dict[int, float] = ours.recv()
    reader.join()
    return [1000 * (got_s[step] - set_s[step]) for step in set_s if step in got_s]


def receive(port: int, key: str, node: str, pipe: Connection) -> None:
    """Record the arrival of each position; positions identify the steps."""
    got_s: dict[int, float] = {}
    url = f"ws://127.0.0.1:{port}"
    headers = {viser_compat.KEY_HEADER: key}
    with connect(
        url,
        subprotocols=[PROTOCOL],
        additional_headers=headers,
        compression=None,
        max_size=None,
    ) as socket:
        socket.send(msgspec.msgpack.encode(CAMERA))
        said_ready = False
        while not pipe.poll():
            try:
                frame = socket.recv(timeout=0.2)
            except TimeoutError:
                if not said_ready:  # The initial scene has been received.
                    pipe.send("ready")
                    said_ready = True
                continue
            now_s = time.monotonic()
            assert isinstance(frame, bytes)
            for message in decoded(frame):
                if message["type"] == "SetPositionMessage" and message["name"] == node:
                    got_s[round(message["position"][0] / _STEP_M)] = now_s
    pipe.send(got_s)
