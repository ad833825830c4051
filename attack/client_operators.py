"""Operators other than the page: a script with the client library, and a Foxglove client."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import socket
import struct
import threading
import time
from collections.abc import Callable

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from attack.track import PATIENCE_S
from tests.support.programs import Program
from tsd_twin.adapters.cmd_vel import PAUSE_S, TWIST
from tsd_twin.adapters.foxglove.sdk import SUBPROTOCOL
from tsd_twin.link_emulation import LinkEmulator, LinkSpec
from tsd_twin.messages.status import RobotStatus

PERIOD_S = 0.02
_ASK_S = 0.5
_ANSWERED_S = 0.005
_LATCHED = ("stopped", "fault")


class ScriptOperator:
    """Process of a script with the client library."""

    def __init__(self, endpoint: str, robot_id: str) -> None:
        self._program = Program(["attack.script", endpoint, robot_id])
        self._program.ready()
        self.pid = self._program.process.pid

    def get_ready(self, max_age_s: float) -> None:
        """Take control with a lease, and arm."""
        self._do("ready", max_age_s)

    def push(self, x: float) -> None:
        """Refresh a velocity at 50 Hz."""
        self._do("push", x)

    def release(self) -> float:
        """Give no further input; return the time of the last one."""
        return float(self._do("release"))

    def close(self) -> None:
        """End the process."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGCONT)
        self._program.clean_up()

    def _do(self, *words: object) -> str:
        stdin, output = self._program.process.stdin, self._program.output
        assert stdin is not None
        before = len(output)
        stdin.write(" ".join(map(str, words)) + "\n")
        stdin.flush()
        end_s = time.monotonic() + PATIENCE_S
        while len(output) == before:
            if time.monotonic() > end_s:
                raise TimeoutError(f"the script does not answer: {self._program.sentence}")
            time.sleep(_ANSWERED_S)
        answer, _, text = output[before].partition(" ")
        if answer != "done":
            raise TimeoutError(text)
        return text


class FoxgloveOperator:
    """Client of a `tsd-foxglove` process, over an emulated link."""

    def __init__(self, endpoint: str, turning: bool, status: Callable[[], RobotStatus]) -> None:
        self._status, self._axis = status, "angular" if turning else "linear"
        self._adapter = Program(["tsd_foxglove", "--connect", endpoint, "--port", "0"])
        self.pid = self._adapter.process.pid
        url = self._adapter.ready().split()[-1]
        port = re.findall(r":(\d+)", url)[-1]
        self.link = LinkEmulator(LinkSpec(), "tcp/127.0.0.1:0", f"tcp/127.0.0.1:{port}")
        self.link.start()
        near = socket.create_connection(
            ("127.0.0.1", int(self.link.endpoint.rpartition(":")[2])), PATIENCE_S
        )
        self._socket = connect(
            url, sock=near, subprotocols=[Subprotocol(SUBPROTOCOL)], compression=None
        )
        self._services: dict[str, int] = {}
        self._x: float | None = None
        self._given_s = 0.0
        self._lock = threading.Lock()
        self._ends = threading.Event()
        channel = {"id": 1, "topic": "/cmd_vel", "encoding": "json", "schemaName": TWIST}
        self._socket.send(json.dumps({"op": "advertise", "channels": [channel]}))
        self._threads = [threading.Thread(target=work) for work in (self._read, self._publish)]
        for thread in self._threads:
            thread.start()

    def get_ready(self, max_age_s: float) -> None:  # noqa: ARG002  The adapter chooses its lease.
        """Take control and arm, then pause, as the adapter requires.

        Raises:
            TimeoutError: If the robot does not become ready.
        """
        end_s = time.monotonic() + PATIENCE_S
        while not self._is_ready():
            if time.monotonic() > end_s:
                raise TimeoutError(f"the robot is {self._status().mode}: {self._adapter.sentence}")
            self._call("/reset" if self._status().mode in _LATCHED else "/arm")
            time.sleep(_ASK_S)
        time.sleep(PAUSE_S + 0.1)

    def push(self, x: float) -> None:
        """Publish a twist at 50 Hz."""
        with self._lock:
            self._x = x

    def release(self) -> float:
        """Publish no further twist; return the time of the last one."""
        with self._lock:
            self._x = None
            return self._given_s

    def close(self) -> None:
        """End client, link and adapter."""
        self._ends.set()
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGCONT)
        self._adapter.clean_up()
        self.link.close()
        self._socket.close()
        for thread in self._threads:
            thread.join()

    def _is_ready(self) -> bool:
        status = self._status()
        return status.mode == "ready" and (status.lease.holder or "").startswith("foxglove")

    def _call(self, service: str) -> None:
        if (number := self._services.get(service)) is not None:
            self._send(struct.pack("<BIII", 2, number, 1, 4) + b"json{}")

    def _publish(self) -> None:
        while not self._ends.wait(PERIOD_S):
            with self._lock:
                if self._x is None:
                    continue
                twist = {self._axis: {"x": self._x}}
                if self._send(struct.pack("<BI", 1, 1) + json.dumps(twist).encode()):
                    self._given_s = time.monotonic()

    def _send(self, data: bytes) -> bool:
        try:
            self._socket.send(data)
        except (ConnectionClosed, OSError):
            return False
        return True

    def _read(self) -> None:
        # The library answers pings during this loop.
        with contextlib.suppress(ConnectionClosed, OSError):
            for message in self._socket:
                if isinstance(message, str) and '"advertiseServices"' in message:
                    for service in json.loads(message)["services"]:
                        self._services[service["name"]] = service["id"]
