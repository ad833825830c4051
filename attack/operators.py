"""Operators of robots under attack: a program on the bus, and a page behind a gateway."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import threading
import time
from typing import Protocol

import msgspec

from attack.track import PATIENCE_S
from tests.support.pretend_page import PretendPage
from tests.support.programs import Program
from tsd_twin.bus import Bus, client_config
from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.client.protocol import ControlProtocol
from tsd_twin.errors import BusError
from tsd_twin.messages.cdr import BASE
from tsd_twin.messages.services import HolderRequest, LeaseReply, LeaseRequest, decode_json
from tsd_twin.messages.status import RobotStatus
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


class UncheckedOperator:
    """Bus client without client-side checks: commands echo the latest status, however old.

    It ignores the mode and a missing status, and sends no final zero.
    """

    def __init__(self, endpoint: str, robot_id: str) -> None:
        self._bus = Bus(client_config([endpoint]))
        if not self._bus.wait_for_peer(PATIENCE_S):
            raise TimeoutError(f"no robot answers at {endpoint}")
        self._link = _linked(self._bus, robot_id)
        # Not fed with statuses, so that it never gives up the lease.
        self._driver: ControlProtocol | None = None
        self._x: float | None = None
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    @property
    def status(self) -> RobotStatus | None:
        """Latest status."""
        return self._link.snapshot.status

    @property
    def link(self) -> RobotMonitor:
        """Connection to the robot."""
        return self._link

    @property
    def driver(self) -> ControlProtocol:
        """Current lease.

        Raises:
            TimeoutError: If it has never become ready.
        """
        if self._driver is None:
            raise TimeoutError("it has no lease")
        return self._driver

    def renew(self) -> None:
        """Renew the lease without a command."""
        lease = self.driver.lease_hex
        self._ask(LeaseRequest(op="renew", operator="raw", lease=lease))

    def call(self, service: Service, request: msgspec.Struct) -> None:
        """Call a service and ignore the response."""
        self._link.call(service, msgspec.json.encode(request), 1.0)

    def _ask(self, request: LeaseRequest) -> LeaseReply:
        answer = self._link.call(Service.LEASE, msgspec.json.encode(request), 1.0)
        if answer is None:
            return LeaseReply(False, reason="the robot does not answer")
        return decode_json(answer, LeaseReply, "a reply")

    def get_ready(self, max_age_s: float) -> None:
        """Take control with a lease, and arm; retry until the robot is ready.

        Raises:
            TimeoutError: If the robot does not become ready.
        """
        deadline_s = time.monotonic() + PATIENCE_S
        lease = LeaseRequest(op="acquire", operator="raw", take_over=True, max_age_s=max_age_s)
        reply = self._ask(lease)
        while not reply.granted or reply.lease is None:
            _check(deadline_s, reply.reason)
            time.sleep(0.1)
            reply = self._ask(lease)
        driver = ControlProtocol(self._link.id, self._link.robot, "raw")
        driver.grant(reply, time.monotonic())
        self._driver = driver
        granted_s = time.monotonic()
        renewal = LeaseRequest(op="renew", operator="raw", lease=reply.lease)
        steps = {"stopped": Service.RESET, "fault": Service.RESET, "disarmed": Service.ARM}
        while True:
            # A status in flight when the lease was granted does not show it.
            status = self.status if time.monotonic() - granted_s > 0.15 else None
            if status is not None and status.mode == "ready" and status.lease.holder == "raw":
                return
            if status is not None and status.mode in steps:
                self.call(steps[status.mode], HolderRequest(reply.lease))
            self._ask(renewal)
            _check(deadline_s, f"the robot is {status.mode if status else 'silent'}")
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
        self._link.close()
        self._bus.close()

    def _run(self) -> None:
        next_s = time.monotonic()
        while not self._ends.wait(max(0.0, next_s - time.monotonic())):
            next_s = max(next_s + PERIOD_S, time.monotonic())
            self._link.poll(time.monotonic())
            if self._driver is not None and (x := self._x) is not None:
                now_s, seen = time.monotonic(), self._link.snapshot.status_seq
                self._link.send(self._driver.command((x, 0.0, 0.0), BASE, now_s, seen))


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


def _linked(bus: Bus, robot_id: str) -> RobotMonitor:
    """Return a link to a robot as soon as it is available."""
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            return RobotMonitor(bus, robot_id)
        except BusError as error:
            _check(deadline_s, str(error))


def _check(deadline_s: float, why: str) -> None:
    if time.monotonic() > deadline_s:
        raise TimeoutError(f"not ready to drive: {why}")
