"""Benchmark of the dashboard's load with one and with twenty viewers, while the robot drives."""

from __future__ import annotations

import json
import multiprocessing as mp
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from typing import cast

import msgspec
import numpy as np
import psutil
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from bench.bus import program
from bench.table import Row, percentile
from tests.support.robot_feed import RobotFeed
from tests.support.viser_client import CAMERA, decoded
from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.dashboard.scene import viser_compat
from tsd_twin.dashboard.scene.scene import Scene

_SECONDS, _FRAMES = 8.0, 600
_SMALLEST = 1.0, 30
_STEP_M = 0.01
PROTOCOL = Subprotocol("viser-v1.1.1")


def rows(*, smallest: bool = False) -> Iterator[Row]:
    """Measure the real processes, then only the scene from setting a pose to the socket."""
    seconds, frames = _SMALLEST if smallest else (_SECONDS, _FRAMES)
    loads = ((1, 15.0), (20, 40.0))[: 1 if smallest else None]
    mock = [sys.executable, "-m", "tsd_mock", "--listen", "tcp/127.0.0.1:0", "--until-eof"]
    for viewers, share in loads:
        with program(mock) as endpoint:
            page = [sys.executable, "-m", "tsd_dashboard", "--port", "0", "--until-eof"]
            served = program([*page, "--connect", endpoint])
            with served as url:
                cpu, sent = load(served.process.pid, url, viewers, seconds)
        hz = f"{sent['frames_hz']:.0f} frames a second"
        yield Row(f"dashboard, {viewers} viewer(s), of one core", cpu, share, "%", hz)
        yield Row(f"scene, each of {viewers}", sent["scene_kB_s"], 70, "kB/s", "")
        both = sent["scene_kB_s"] + sent["teleop_kB_s"]
        yield Row(f"scene, numbers and plots, each of {viewers}", both, 100, "kB/s", "")
    floor_ms, times_ms = latencies(frames)
    comparison = f"an empty frame of viser {floor_ms:.1f} ms"
    yield Row("set to socket, p99", percentile(times_ms, 0.99), 12.0, "ms", comparison)


def load(pid: int, url: str, viewers: int, seconds: float) -> tuple[float, dict[str, float]]:
    """Return the CPU load in percent of a core, and the data sent to each viewer."""
    command = [sys.executable, "-m", "bench.viewers", url, str(viewers), str(seconds), "drive"]
    watching = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert watching.stdout is not None
    watching.stdout.readline()
    dashboard = psutil.Process(pid)
    dashboard.cpu_percent()
    sent = json.loads(watching.stdout.readline())
    cpu = dashboard.cpu_percent()
    watching.wait(20)
    return cpu, sent


def latencies(frames: int) -> tuple[float, list[float]]:
    """Return p99 of a bare viser node and all times of our scene, in ms, at 60 Hz."""
    server = viser_compat.start_server("bench")
    try:
        bare = server.scene.add_frame("/bare", show_axes=False)

        def move_bare(x: float) -> None:
            bare.position = (x, 0.0, 0.0)
            server.flush()

        floor = timed(server.get_port(), "/bare", move_bare, frames)
        feed, scene = RobotFeed(), Scene(server)
        feed.say(pose=np.zeros(3), joints=feed.kinematics.inverse(np.zeros(3)))
        scene.add(cast(RobotMonitor, feed))

        def move_robot(x: float) -> None:
            joints = feed.kinematics.inverse(np.array([0.5, 0.2 * np.sin(x), 0.4]))
            pose = np.array([-x, 0.0, 0.5 * x])
            feed.say(pose=pose, joints=joints, setpoint=joints, truth=pose + 0.01)
            scene.draw()

        return percentile(floor, 0.99), timed(server.get_port(), "/w", move_robot, frames)
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
