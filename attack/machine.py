"""Robot in two processes, node and controller board, so that the hardware outlives its node.

`python -m attack.machine board ROBOT FOLDER` simulates the robot and its board in real time, and
prints the driven distance. `python -m attack.machine node ROBOT FOLDER` runs a robot node that
connects to it through a socket in FOLDER. Both end with their standard input.
"""

from __future__ import annotations

import contextlib
import select
import socket
import struct
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from attack.track import Odometer
from tsd_twin import robots
from tsd_twin.bus import Bus, node_config
from tsd_twin.lie import Array
from tsd_twin.messages.services import Description
from tsd_twin.node import RobotNode
from tsd_twin.robots import RobotDescription
from tsd_twin.simulation import BoardModel, SimRobot

PERIOD_S = 0.01
_BOARD, _NODE = "board.sock", "node.sock"


class SocketHardware:
    """Hardware interface of a node, connected to a simulated board by a socket."""

    def __init__(self, folder: Path) -> None:
        self._socket = _bound(folder / _NODE)
        self._board = str(folder / _BOARD)

    def read(self, now_s: float) -> Array | None:  # noqa: ARG002  The shape.
        """Return the latest measurement (n,) since the last call, or None."""
        blocks = _waiting(self._socket)
        return _numbers(blocks[-1]) if blocks else None

    def write(self, setpoint: Array, now_s: float) -> None:  # noqa: ARG002  The shape.
        """Send a setpoint (n,); if the board is too slow, it is lost and the next one follows."""
        with contextlib.suppress(BlockingIOError):
            self._socket.sendto(_block(setpoint), self._board)

    def hardware(self) -> Mapping[str, Any]:
        """Hardware section of the status."""
        return {"kind": "board in a process of its own"}

    def close(self) -> None:
        """Close the socket; the board's watchdog then stops the robot."""
        self._socket.close()


def run_board(robot: RobotDescription, folder: Path) -> None:
    """Simulate the robot and its board at 100 Hz until standard input ends."""
    board, link = BoardModel(robot, SimRobot(robot)), _bound(folder / _BOARD)
    odometer = Odometer(robot.kinematics())
    print("ready: the board", flush=True)
    next_s = time.monotonic()
    while True:
        left_s = max(0.0, next_s - time.monotonic())
        readable = select.select([link, sys.stdin], [], [], left_s)[0]
        if sys.stdin in readable:
            return
        now_s = time.monotonic()
        for block in _waiting(link):
            board.write(_numbers(block), now_s)
        if now_s >= next_s:
            next_s = max(next_s + PERIOD_S, now_s)
            measured, truth = board.read(now_s), board.truth(now_s)
            if measured is not None:
                # There may be no node, or a new one that has not opened its socket yet.
                with contextlib.suppress(OSError):
                    link.sendto(_block(measured), str(folder / _NODE))
            way_m, speed_mps = odometer.update(truth.pose, truth.twist)
            print(f"at {now_s:.6f} {way_m:.6f} {speed_mps:.6f}", flush=True)


def run_node(robot: RobotDescription, text: str, folder: Path) -> None:
    """Run a node on a free port until standard input ends."""
    stop = threading.Event()
    with Bus(node_config(["tcp/127.0.0.1:0"])) as bus:
        shown = Description(text, f'<robot name="{robot.name}"/>')
        node = RobotNode(bus, robot.name, robot, SocketHardware(folder), shown)
        threading.Thread(target=_stop_at_the_end, args=(stop,), daemon=True).start()
        print(f"ready: {bus.endpoints()[0]}", flush=True)
        node.run(stop)


def _stop_at_the_end(stop: threading.Event) -> None:
    sys.stdin.read()
    stop.set()


def _bound(path: Path) -> socket.socket:
    path.unlink(missing_ok=True)  # Left by a node that was killed.
    bound = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    bound.bind(str(path))
    bound.setblocking(False)
    return bound


def _waiting(link: socket.socket) -> list[bytes]:
    blocks: list[bytes] = []
    with contextlib.suppress(BlockingIOError):
        while True:
            blocks.append(link.recv(4096))
    return blocks


def _block(numbers: Array) -> bytes:
    return struct.pack(f"<{len(numbers)}d", *numbers)


def _numbers(block: bytes) -> Array:
    return np.frombuffer(block, dtype="<f8").copy()


def main(what: str, path: str, folder: str) -> None:
    """Run the board or the node."""
    text = Path(path).read_text(encoding="utf-8")
    robot = robots.parse_description(text, path)
    if what == "board":
        run_board(robot, Path(folder))
    else:
        run_node(robot, text, Path(folder))


if __name__ == "__main__":
    main(*sys.argv[1:])
