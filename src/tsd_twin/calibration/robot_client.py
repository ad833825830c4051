"""Robot client of calibration: finds the robot, holds the lease, arms, publishes commands, disarms
on exit.
"""

from __future__ import annotations

import argparse
import contextlib
import queue
import signal
import time
from collections.abc import Callable, Generator, Iterator
from typing import Any, Self

import msgspec

from tsd_twin import robots
from tsd_twin.bus import DEFAULT_ENDPOINT, Bus, as_client, client_config, from_file
from tsd_twin.calibration.terminal import KeyWatcher
from tsd_twin.client.protocol import ControlProtocol, TwistCommand
from tsd_twin.errors import BusError, MessageError, NoAnswerError, TwinError
from tsd_twin.lie import Array
from tsd_twin.messages import topics
from tsd_twin.messages.commands import Sample
from tsd_twin.messages.ros import BASE
from tsd_twin.messages.services import (
    Description,
    HolderRequest,
    LeaseReply,
    LeaseRequest,
    Reply,
    StopRequest,
    decode_json,
)
from tsd_twin.messages.status import Status, decode_stamp, decode_status
from tsd_twin.messages.topics import QoS, Service
from tsd_twin.robots import RobotDescription

_DISCOVERY_TIMEOUT_S = 5.0


def fetch_description(bus: Bus, robot_id: str) -> str:
    """Return the TOML of a robot; retries, since a new session may not reach it at once."""
    end_s = time.monotonic() + _DISCOVERY_TIMEOUT_S
    while True:
        try:
            answer = bus.query(Service.DESC.key(robot_id), b"")
            return decode_json(answer, Description, "a description").robot
        except NoAnswerError:
            if time.monotonic() > end_s:
                raise


def find_only_robot(bus: Bus) -> str:
    """Return the id of the robot on the bus.

    Raises:
        TwinError: there is no robot, or more than one.
    """
    found = sorted(topics.robot_of(key) for key in bus.living_tokens(topics.alive_key("*")))
    if len(found) != 1:
        raise TwinError(
            f"choose one with --id: {', '.join(found)} are on the bus"
            if found
            else "no robot is on the bus: start tsd-bridge or tsd-mock, or say --connect"
        )
    return found[0]


_STATUS_TIMEOUT_S = 1.5
"""Status timeout; after it the link to the robot counts as lost."""
_RENEW_PERIOD_S = 0.5
_ARMING_TIMEOUT_S = 60.0
_MAX_TRIES = 3
_REPLY_TIMEOUT_S = 0.5


class RobotClient:
    """Robot client: holds the lease inside its context; disarms and releases on exit.

    If this process dies instead, the lease runs out and the robot spins down by itself.
    """

    def __init__(self, bus: Bus, robot_id: str, name: str) -> None:
        """Fetch the description of a robot.

        Raises:
            BusError: the robot does not answer.
            RobotFileError: its description cannot be used.
        """
        self.id, self.name = robot_id, topics.checked(name)
        self.bus = bus
        self.description_text = fetch_description(bus, robot_id)
        """The TOML of its description."""
        self.robot: RobotDescription = robots.parse_description(
            self.description_text, f"description of {robot_id}"
        )
        self._lease = ""
        self._renewed_s = 0.0
        self._statuses: queue.SimpleQueue[Sample] = queue.SimpleQueue()
        bus.subscribe(topics.STATUS.key(robot_id), self._statuses.put)
        self._protocol = ControlProtocol(robot_id, self.robot, name)
        self.max_age_s: float | None = None
        """Maximum command age to request with the lease; None for the default."""
        self._previous_handler: Any = None

    def __enter__(self) -> Self:
        # SIGTERM ends it like Ctrl-C, through `__exit__`.
        self._previous_handler = signal.signal(signal.SIGTERM, signal.default_int_handler)
        wish = LeaseRequest(op="acquire", operator=self.name, max_age_s=self.max_age_s)
        reply = self._call_lease_service(wish)
        if not reply.granted or reply.lease is None:
            signal.signal(signal.SIGTERM, self._previous_handler)
            raise TwinError(f"{self.id} gives no control: {reply.reason}")
        self._lease, self._renewed_s = reply.lease, time.monotonic()
        self._protocol.grant(reply, self._renewed_s)
        return self

    def __exit__(self, *_: object) -> None:
        # A second interrupt must not leave the wheels spinning.
        impatient = signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        try:
            self._disarm()
            self._call_lease_service(
                LeaseRequest(op="release", operator=self.name, lease=self._lease)
            )
        finally:
            signal.signal(signal.SIGINT, impatient)
            signal.signal(signal.SIGTERM, self._previous_handler)

    def arm(self) -> Iterator[float]:
        """Arm, and yield the progress, 0 to 1, until the robot is ready.

        Raises:
            TwinError: the robot refuses, aborts, or takes too long.
        """
        reply = self._call_service(Service.ARM, HolderRequest(self._lease))
        if reply is None or not reply.ok:
            reason = "it does not answer" if reply is None else reply.reason
            raise TwinError(f"{self.id} does not arm: {reason}")
        end_s = time.monotonic() + _ARMING_TIMEOUT_S
        arming = False
        while (status := self.status()).mode != "ready":
            # The first status may be older than the request.
            arming = arming or status.mode == "arming"
            if (arming and status.mode != "arming") or time.monotonic() > end_s:
                raise TwinError(f"{self.id} does not get ready: {status.stop_reason}")
            if status.arming is not None:
                yield status.arming.progress

    def hold(self, seconds: float) -> Iterator[float]:
        """Keep the robot ready at standstill, and yield the elapsed time.

        Raises:
            TwinError: the robot is not ready, another operator has control, or its status is late.
        """
        began_s = time.monotonic()
        while (held_s := time.monotonic() - began_s) < seconds:
            self.require_mode(self.status(), "ready")
            yield held_s

    def require_mode(self, status: Status, *modes: str) -> None:
        """Raise unless the robot is in one of these modes and this client holds the lease.

        Raises:
            TwinError: the robot is in another mode, or another operator has control.
        """
        if status.mode not in modes:
            raise TwinError(f"{self.id} is {status.mode}: {status.stop_reason}")
        if status.lease.holder != self.name:
            raise TwinError(f"{status.lease.holder or 'no operator'} has control of {self.id} now")

    def status(self) -> Status:
        """Wait for the next status while renewing the lease, and return it.

        Raises:
            TwinError: the status timeout has passed; the robot has been commanded to stop.
        """
        while True:
            if time.monotonic() - self._renewed_s > _RENEW_PERIOD_S:
                self._renewed_s = time.monotonic()
                renew = LeaseRequest(op="renew", operator=self.name, lease=self._lease)
                self._call_lease_service(renew)
            try:
                return self._decode_newest(self._statuses.get(timeout=_STATUS_TIMEOUT_S))
            except MessageError:
                continue  # Invalid sample from another publisher.
            except queue.Empty:
                self.stop("status timeout")
                raise TwinError(
                    f"{self.id} has sent no status for {_STATUS_TIMEOUT_S:g} s"
                ) from None

    def newest_status(self) -> Status | None:
        """Return the newest unread status, None when there is none; does not wait."""
        try:
            return self._decode_newest(self._statuses.get_nowait())
        except (MessageError, queue.Empty):
            return None

    def command(self, twist: Array) -> TwistCommand:
        """Return the next command, with a twist (3,) in the body frame.

        Raises:
            ControlLost: another operator has control.
        """
        return self._protocol.command(twist, BASE, time.monotonic())

    def _decode_newest(self, sample: Sample) -> Status:
        while not self._statuses.empty():  # Only this thread reads the queue.
            sample = self._statuses.get()
        status = decode_status(sample.payload)
        seq, _ = decode_stamp(sample.attachment)
        self._protocol.receive_status(status, seq, time.monotonic())
        return status

    def stop(self, reason: str) -> None:
        """Latch a stop; repeated until it is acknowledged or the attempts are used up."""
        request = StopRequest(self.name, reason)
        for _ in range(_MAX_TRIES):
            reply = self._call_service(Service.STOP, request)
            if reply is not None and reply.ok:
                return

    def _disarm(self) -> None:
        """Disarm; if that is refused, another operator holds the lease and is not stopped, or it is
        free.
        """
        request = HolderRequest(self._lease)
        peek = LeaseRequest(op="peek", operator=self.name)
        for _ in range(_MAX_TRIES):
            reply = self._call_service(Service.DISARM, request)
            if reply is not None and (reply.ok or self._call_lease_service(peek).holder):
                return
        self.stop("it could not be disarmed")

    def _call_service(self, service: Service, request: msgspec.Struct) -> Reply | None:
        """Return the reply of a service, None without one."""
        payload = msgspec.json.encode(request)
        try:
            answer = self.bus.query(service.key(self.id), payload, _REPLY_TIMEOUT_S)
            return decode_json(answer, Reply, "an answer")
        except (BusError, MessageError):
            return None

    def _call_lease_service(self, request: LeaseRequest) -> LeaseReply:
        try:
            answer = self.bus.query(Service.LEASE.key(self.id), msgspec.json.encode(request))
            return decode_json(answer, LeaseReply, "an answer")
        except (BusError, MessageError) as error:
            return LeaseReply(False, reason=str(error))


_CONNECT_TIMEOUT_S = 3.0


@contextlib.contextmanager
def connect(args: argparse.Namespace) -> Generator[RobotClient]:
    """Open the bus that the flags name, and find the robot; the lease is not acquired yet.

    Raises:
        TwinError: no answer there, no robot, or more than one to choose from.
    """
    with _open_bus(args) as bus:
        yield RobotClient(bus, args.id or find_only_robot(bus), args.operator)


def add_bus_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of the robot, the bus, the operator and the confirmation."""
    parser.add_argument("--id", help="of the robot on the bus; default: the only one")
    parser.add_argument(
        "--connect",
        action="append",
        metavar="ENDPOINT",
        help=f"where a robot listens, may be repeated; default {DEFAULT_ENDPOINT}",
    )
    parser.add_argument("--zenoh-config", metavar="FILE", help="a JSON5 file, for TLS and access")
    parser.add_argument("--operator", default="lab", help="who takes control; default lab")
    parser.add_argument("--yes", action="store_true", help="begin at once")


def _open_bus(args: argparse.Namespace) -> Bus:
    config = (
        from_file(args.zenoh_config)
        if args.zenoh_config
        else client_config(args.connect or [DEFAULT_ENDPOINT])
    )
    # A camera is connected to the same robot, and not a peer of this session.
    return Bus(as_client(config, _CONNECT_TIMEOUT_S))


COMMAND_PERIOD_S = 0.02
_FRESH_STATUS_S = 1.0
"""Status timeout, 20 periods; commands without a fresh status are dropped long before it."""


class CommandPublisher:
    """Command publisher: sends twists at 50 Hz for a client that holds the lease.

    Every error is raised and ends the publication: the robot then stops by itself, and the client
    disarms it on exit. The robot stops likewise when this process is killed.
    """

    def __init__(self, client: RobotClient, keys: KeyWatcher) -> None:
        self._client, self._keys = client, keys
        # After a longer pause the robot has begun to stop, and must not be restarted.
        limits, age_s = client.robot.limits, client.max_age_s or 0.0
        self._pause_s = limits.command_timeout_s + max(0.0, age_s - limits.max_command_age_s)
        key = topics.twist_key(client.id, client.name)
        self._commands = client.bus.publisher(key, QoS.REAL_TIME, topics.TWIST.type)
        self._stops: int | None = None

    def run(self, step: Callable[[float], Array | None]) -> Iterator[None]:
        """Send the twist that `step` returns for each time, until it is None; yield after each.

        Raises:
            TwinError: a key was pressed, the robot began to stop by itself, another operator has
                control, the status timeout has passed, or this process was delayed; `step` may
                raise more.
        """
        heard_s = last_s = time.monotonic()
        while True:
            now_s = time.monotonic()
            if now_s - last_s > self._pause_s:
                raise TwinError(f"this program was held up for {now_s - last_s:.1f} s")
            last_s = now_s
            if self._has_fresh_status():
                heard_s = now_s
            if now_s - heard_s > _FRESH_STATUS_S:
                raise TwinError(f"{self._client.id} has sent no status for {_FRESH_STATUS_S:g} s")
            twist = step(now_s)
            if twist is None:
                return
            self._publish(twist)
            yield
            left_s = now_s + COMMAND_PERIOD_S - time.monotonic()
            if self._keys.pressed(max(0.0, left_s)):
                raise TwinError("stopped by a key")

    def _has_fresh_status(self) -> bool:
        """Return whether there is a new status; raise when it reports a stop."""
        status = self._client.newest_status()
        if status is None:
            return False
        self._client.require_mode(status, "ready", "driving")
        self._stops = status.stops if self._stops is None else self._stops
        if status.stops > self._stops:
            raise TwinError(f"{self._client.id} stopped by itself: {status.stop_reason}")
        return True

    def _publish(self, twist: Array) -> None:
        command = self._client.command(twist)
        self._commands.put(command.payload, command.attachment)
