"""Operators of robots under attack: a program on the bus, and a page behind a gateway."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import threading
import time
from typing import Protocol

from attack.track import PATIENCE_S
from tests.support.bus_operator import BusOperator
from tests.support.pretend_page import PretendPage
from tests.support.programs import Program
from tests.support.robot_node import behind
from tsd_twin.messages.topics import Service

PERIOD_S = 0.02


class Operator(Protocol):
    """Interface of a test operator: acquire control, hold the stick, release it."""

    def get_ready(self, max_age_s: float) -> None:
        """Take control with a lease, and arm."""
        ...

    def push(self, x: float) -> None:
        """Hold the stick: first component of the twist, the others zero."""
        ...

    def release(self) -> object:
        """Release the stick."""
        ...

    def close(self) -> None:
        """Release all resources."""
        ...


class UncheckedOperator(BusOperator):
    """Bus client without client-side checks: commands echo the latest status, however old.

    It ignores the mode, and sends no final zero.
    """

    def __init__(self, endpoint: str, name: str) -> None:
        super().__init__(behind(endpoint, name, name), "raw")
        self._x: float | None = None
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def renew(self) -> None:
        """Renew the lease without a command."""
        self.ask(Service.LEASE, op="renew", operator=self.name, lease=self.lease)

    def get_ready(self, max_age_s: float | None = None) -> None:
        """Take control with a lease, and arm; retry until the robot is ready.

        Raises:
            TimeoutError: If the robot does not become ready.
        """
        deadline_s = time.monotonic() + PATIENCE_S
        while not (reply := self.acquire(take_over=True, max_age_s=max_age_s))["granted"]:
            _check(deadline_s, reply["reason"])
            time.sleep(0.1)
        self.wait_for_news()  # A status in flight does not show the lease.
        steps = {"stopped": Service.RESET, "fault": Service.RESET, "disarmed": Service.ARM}
        while (mode := self.status.mode) != "ready" or self.status.lease.holder != self.name:
            if mode in steps:
                self.ask(steps[mode], lease=self.lease)
            self.renew()
            _check(deadline_s, f"the robot is {mode}")
            time.sleep(0.05)

    def push(self, x: float) -> None:
        """Hold the stick."""
        self._x = x

    def release(self) -> None:
        """Stop sending, without a zero."""
        self._x = None

    def close(self) -> None:
        """Leave the bus."""
        self._ends.set()
        self._thread.join()
        self.bus.close()

    def _run(self) -> None:
        while not self._ends.wait(PERIOD_S):
            if (x := self._x) is not None:
                self.send((x, 0.0, 0.0))


class PageBehindGateway:
    """Operator at a page of a dashboard, both processes that are restarted after a crash."""

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._dashboard: Program | None = None
        self._page: PretendPage | None = None

    def get_ready(self, max_age_s: float) -> None:
        """Take control with a lease, and arm; restart processes that have ended."""
        if self._dashboard is None or self._dashboard.process.poll() is not None:
            self.close()
            flags = ("--port", "0", "--connect", self._endpoint)
            self._dashboard = Program(["tsd_dashboard", *flags])
        if self._page is None or self._page.process.poll() is not None:
            self._close_page()
            (url,) = re.findall(r"http://\S+", self._dashboard.ready())
            self._page = PretendPage(url)
        else:
            self._page.do("release")
        self._page.get_ready(max_age_s)

    def push(self, x: float) -> None:
        """Hold the stick."""
        assert self._page is not None
        self._page.do("push", x)

    def release(self) -> None:
        """Release the stick, if the page is still running."""
        if self._page is not None and self._page.process.poll() is None:
            # A page whose gateway has died ends automatically.
            with contextlib.suppress(BrokenPipeError, AssertionError):
                self._page.do("release")

    def close(self) -> None:
        """End both processes."""
        self._close_page()
        if self._dashboard is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._dashboard.process.pid, signal.SIGCONT)
            self._dashboard.clean_up()
            self._dashboard = None

    def _close_page(self) -> None:
        if self._page is not None:
            self._page.clean_up()
            self._page = None

    @property
    def gateway_pid(self) -> int:
        """Process id of the dashboard."""
        assert self._dashboard is not None
        return self._dashboard.process.pid

    @property
    def page_pid(self) -> int:
        """Process id of the page."""
        assert self._page is not None
        return self._page.process.pid


def _check(deadline_s: float, why: str) -> None:
    if time.monotonic() > deadline_s:
        raise TimeoutError(f"not ready to drive: {why}")
