"""Somebody who has control of a robot on the bus, from here: never longer than all is well."""

from __future__ import annotations

import queue
import signal
import time
from collections.abc import Iterator
from typing import Any, Self

import msgspec

from tsd_twin import robots, topics
from tsd_twin.bus import Bus
from tsd_twin.client.protocol import ControlProtocol, TwistCommand
from tsd_twin.errors import BusError, MessageError, TwinError
from tsd_twin.lab.meeting import description
from tsd_twin.lie import Array
from tsd_twin.messages.command import Sample
from tsd_twin.messages.ros import BASE
from tsd_twin.messages.service import (
    HolderRequest,
    LeaseReply,
    LeaseRequest,
    Reply,
    StopRequest,
    decode_json,
)
from tsd_twin.messages.status import Status, decode_stamp, decode_status
from tsd_twin.robots import Robot
from tsd_twin.topics import Service

_SILENT_S = 1.5
"""A robot that says nothing for this long is not trusted to hear anything either."""
_RENEW_S = 0.5
_ARMING_S = 60.0
_TRIES = 3
_ANSWER_S = 0.5


class Operator:
    """Takes control when entered; whatever happens inside, the robot is disarmed and let go of.

    If this process dies instead, the lease runs out and the robot spins down by itself.
    """

    def __init__(self, bus: Bus, robot_id: str, name: str) -> None:
        """Fetch the description of a robot.

        Raises:
            BusError: it does not answer.
            RobotFileError: its description cannot be used.
        """
        self.id, self.name = robot_id, topics.checked(name)
        self.bus = bus
        self.text = description(bus, robot_id)
        """The TOML of its description."""
        self.robot: Robot = robots.parse(self.text, f"description of {robot_id}")
        self._lease = ""
        self._renewed_s = 0.0
        self._statuses: queue.SimpleQueue[Sample] = queue.SimpleQueue()
        bus.watch(topics.STATUS.key(robot_id), self._statuses.put)
        self._protocol = ControlProtocol(robot_id, self.robot, name)
        self.max_age_s: float | None = None
        """How old commands may be, to be asked for with control; None: as usual."""
        self._before: Any = None

    def __enter__(self) -> Self:
        # Told to end, it ends as by Ctrl-C: through `__exit__`.
        self._before = signal.signal(signal.SIGTERM, signal.default_int_handler)
        wish = LeaseRequest(op="acquire", operator=self.name, max_age_s=self.max_age_s)
        reply = self._ask_lease(wish)
        if not reply.granted or reply.lease is None:
            signal.signal(signal.SIGTERM, self._before)
            raise TwinError(f"{self.id} gives no control: {reply.reason}")
        self._lease, self._renewed_s = reply.lease, time.monotonic()
        self._protocol.grant(reply, self._renewed_s)
        return self

    def __exit__(self, *_: object) -> None:
        # Whoever is impatient now would leave the wheels spinning.
        impatient = signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        try:
            self._disarm()
            self._ask_lease(LeaseRequest(op="release", operator=self.name, lease=self._lease))
        finally:
            signal.signal(signal.SIGINT, impatient)
            signal.signal(signal.SIGTERM, self._before)

    def get_ready(self) -> Iterator[float]:
        """Arm, and yield how far that is, 0 to 1, until the robot is ready.

        Raises:
            TwinError: it refuses, gives up, or takes too long.
        """
        reply = self._ask(Service.ARM, HolderRequest(self._lease))
        if reply is None or not reply.ok:
            reason = "it does not answer" if reply is None else reply.reason
            raise TwinError(f"{self.id} does not arm: {reason}")
        end_s = time.monotonic() + _ARMING_S
        arming = False
        while (status := self.status()).mode != "ready":
            # The first status may be from before it was asked.
            arming = arming or status.mode == "arming"
            if (arming and status.mode != "arming") or time.monotonic() > end_s:
                raise TwinError(f"{self.id} does not get ready: {status.stop_reason}")
            if status.arming is not None:
                yield status.arming.progress

    def hold(self, seconds: float) -> Iterator[float]:
        """Keep the robot ready, told to stand, and yield how long it has been so.

        Raises:
            TwinError: it is not ready any more, or another has control, or it fell silent.
        """
        began_s = time.monotonic()
        while (held_s := time.monotonic() - began_s) < seconds:
            self.check(self.status(), "ready")
            yield held_s

    def check(self, status: Status, *modes: str) -> None:
        """Raise what is wrong, unless the robot is in one of these modes and still ours.

        Raises:
            TwinError: it is not ready any more, or another has control.
        """
        if status.mode not in modes:
            raise TwinError(f"{self.id} is {status.mode}: {status.stop_reason}")
        if status.lease.holder != self.name:
            raise TwinError(f"{status.lease.holder or 'nobody'} has control of {self.id} now")

    def status(self) -> Status:
        """Return the next status, and keep control meanwhile.

        Raises:
            TwinError: none comes; the robot has been told to stop.
        """
        while True:
            if time.monotonic() - self._renewed_s > _RENEW_S:
                self._renewed_s = time.monotonic()
                renew = LeaseRequest(op="renew", operator=self.name, lease=self._lease)
                self._ask_lease(renew)
            try:
                return self._read(self._statuses.get(timeout=_SILENT_S))
            except MessageError:
                continue  # Somebody else writes on this key.
            except queue.Empty:
                self.stop("it fell silent")
                raise TwinError(f"{self.id} has said nothing for {_SILENT_S:g} s") from None

    def news(self) -> Status | None:
        """Return the newest status since the last one, None when there is none; do not wait."""
        try:
            return self._read(self._statuses.get_nowait())
        except (MessageError, queue.Empty):
            return None

    def command(self, twist: Array) -> TwistCommand:
        """Return the next command, with a twist (3,) in the body frame.

        Raises:
            ControlLost: another has control.
        """
        return self._protocol.command(twist, BASE, time.monotonic())

    def _read(self, sample: Sample) -> Status:
        while not self._statuses.empty():  # Only this thread takes any.
            sample = self._statuses.get()
        status = decode_status(sample.payload)
        seq, _ = decode_stamp(sample.attachment)
        self._protocol.receive_status(status, seq, time.monotonic())
        return status

    def stop(self, reason: str) -> None:
        """Stop the robot and latch it, again until that is acknowledged or it is of no use."""
        request = StopRequest(self.name, reason)
        for _ in range(_TRIES):
            reply = self._ask(Service.STOP, request)
            if reply is not None and reply.ok:
                return

    def _disarm(self) -> None:
        """Disarm; if that is refused, another has control and is not to be stopped, or nobody."""
        request = HolderRequest(self._lease)
        peek = LeaseRequest(op="peek", operator=self.name)
        for _ in range(_TRIES):
            reply = self._ask(Service.DISARM, request)
            if reply is not None and (reply.ok or self._ask_lease(peek).holder):
                return
        self.stop("it could not be disarmed")

    def _ask(self, service: Service, request: msgspec.Struct) -> Reply | None:
        """Return the answer of a service, None when there is none."""
        payload = msgspec.json.encode(request)
        try:
            answer = self.bus.ask(service.key(self.id), payload, _ANSWER_S)
            return decode_json(answer, Reply, "an answer")
        except (BusError, MessageError):
            return None

    def _ask_lease(self, request: LeaseRequest) -> LeaseReply:
        try:
            answer = self.bus.ask(Service.LEASE.key(self.id), msgspec.json.encode(request))
            return decode_json(answer, LeaseReply, "an answer")
        except (BusError, MessageError) as error:
            return LeaseReply(False, reason=str(error))
