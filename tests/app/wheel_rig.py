"""Robot with wheels but no controller board: devices, bridge, dashboard and page, in processes."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tests.app.bridge_machine import wait_until
from tests.support.page_client import Page

if TYPE_CHECKING:
    from tests.support.programs import Program

_STANDS_S = 0.7


@dataclass
class Rig:
    """Robot with all its processes, and a page that drives it."""

    name: str
    motors: Program
    """Simulated wheels; show `driven` and more on request."""
    servos: Program | None
    """Simulated gimbals on another line."""
    bridge: Program
    page: Page
    speed_mps: float

    def show(self) -> dict[str, Any]:
        """Return the state of the wheels."""
        count = len(self.motors.output)
        self.tell("show")
        wait_until(lambda: len(self.motors.output) > count, "an answer of the motors")
        return json.loads(self.motors.output[count])

    def tell(self, command: str) -> None:
        """Send a command to the wheels, or with `servos` before it to the gimbals."""
        device = self.motors
        if command.startswith("servos "):
            assert self.servos is not None
            device, command = self.servos, command.removeprefix("servos ")
        assert device.process.stdin is not None
        device.process.stdin.write(command + "\n")
        device.process.stdin.flush()

    def mend(self) -> None:
        """Take all injected faults away."""
        self.tell("mend")
        if self.servos is not None:
            self.tell("servos mend")

    @property
    def status(self) -> dict[str, Any]:
        return self.page.state["status"]

    @property
    def code(self) -> str:
        """Code of the reason of the latest stop."""
        return (self.status.get("stop") or {}).get("code", "")

    @property
    def driven(self) -> bool:
        return any(self.show()["driven"])

    def drive(self) -> None:
        """Get ready once all devices answer, and hold the stick."""
        self.page.let_go()
        self.page.until(self._answers)
        self.page.make_ready()
        self.page.drive(self.speed_mps, until=lambda: self.driven)

    def stands(self) -> bool:
        """Return whether no wheel is driven for a while, with the stick held."""
        end_s = time.monotonic() + _STANDS_S
        while time.monotonic() < end_s:
            if self.driven:
                return False
        return True

    def _answers(self) -> bool:
        hardware = self.status["hardware"]
        parts = [hardware[part]["alive"] for part in ("wheels", "servos") if part in hardware]
        return bool(parts) and all(map(all, parts))


@contextmanager
def opened(
    start: Callable[..., Program],
    name: str,
    motors: Program,
    flags: Sequence[str],
    *,
    servos: Program | None = None,
    speed_mps: float = 0.2,
) -> Generator[Rig]:
    """Start bridge, dashboard and page of devices that are ready."""
    bridge = start("tsd_bridge", "--listen", "tcp/127.0.0.1:0", *flags)
    endpoint = bridge.ready().split()[-1]
    dashboard = start("tsd_dashboard", "--port", "0", "--connect", endpoint)
    port = int(re.findall(r"http://[^:/]+:(\d+)", dashboard.ready())[0])
    page = Page(port, "0123456789abcdef")
    page.until(lambda: page.state)
    try:
        yield Rig(name, motors, servos, bridge, page, speed_mps)
    finally:
        page.close()
