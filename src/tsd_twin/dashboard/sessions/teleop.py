"""Teleoperation by one page: dead-man switch, commands, watchdog and release."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable, Sequence
from enum import StrEnum
from functools import partial
from typing import Any

from tsd_twin.client import ClientError
from tsd_twin.client.protocol import ZERO_TWIST
from tsd_twin.dashboard.sessions.lease import Lease, LeaseClient, reason_of
from tsd_twin.dashboard.sessions.navigation import NavigationSession
from tsd_twin.dashboard.wire.from_page import (
    ClearPlan,
    DriveCommand,
    FollowPlan,
    PlanRequest,
    ReleaseControls,
    SetSpeedLevel,
    TeleopMessage,
)
from tsd_twin.dashboard.wire.to_page import ActionReply, ControlsReleased
from tsd_twin.errors import PathError
from tsd_twin.messages.cdr import BASE
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.status import RobotStatus
from tsd_twin.motion.tracking import ExecutionPhase

COMMAND_TIMEOUT_S = 0.2
"""A page that sends no command for this time has released the controls."""


_TAKE_CONTROL = because(Code.TAKE_CONTROL_FIRST)
ZERO_PERIOD_S = 0.02
ZERO_REPEATS = 25
"""Maximum resends of an unacknowledged zero command."""


class DeadmanState(StrEnum):
    """State of the dead-man switch."""

    FREE = "free"
    """The controls are centred or untouched."""
    HELD = "held"
    MUST_RECENTER = "spent"
    """The server has released the controls; the page must centre them before they act again."""


class DeadmanSwitch:
    """Dead-man switch that requires fresh commands for motion.

    Each end of motion is returned as True exactly once.
    """

    def __init__(self) -> None:
        self.state = DeadmanState.FREE
        self._commanded_s = 0.0

    def on_command(self, now_s: float) -> bool:
        """Process a motion command and return whether it may be sent to the robot."""
        if self.state is DeadmanState.MUST_RECENTER:
            return False
        self.state, self._commanded_s = DeadmanState.HELD, now_s
        return True

    def on_release(self) -> bool:
        """Record that the page has centred its controls; return whether they were held."""
        was, self.state = self.state, DeadmanState.FREE
        return was is DeadmanState.HELD

    def force_release(self) -> bool:
        """Release the controls; the page must centre them before it can drive again."""
        if self.state is not DeadmanState.HELD:
            return False
        self.state = DeadmanState.MUST_RECENTER
        return True

    def refuse_command(self) -> bool:
        """Refuse a command; the page must centre its controls first."""
        was, self.state = self.state, DeadmanState.MUST_RECENTER
        return was is not DeadmanState.MUST_RECENTER

    def silence_s(self, now_s: float) -> float:
        """Return the time since the latest command, or 0 if no control is held."""
        return now_s - self._commanded_s if self.state is DeadmanState.HELD else 0.0


DRIVABLE_MODES = (Mode.READY, Mode.DRIVING)
"""Modes in which a held control moves the robot; in others the dashboard releases it.

A robot that is stopping would accept commands, but here a control must be released before it acts
again.
"""


class TeleopController:
    """Teleoperation by one page with a single path for all commands and releases.

    Event loop only. All controls share one dead-man switch.
    """

    def __init__(
        self,
        lease_client: LeaseClient,
        navigation: NavigationSession,
        send_message: Callable[[Any], None],
    ) -> None:
        self.navigation = navigation
        self._lease_client = lease_client
        self._send_message = send_message
        self._deadman = DeadmanSwitch()
        self._stops = ("", 0)
        self._watchdog: asyncio.TimerHandle | None = None
        self._zeros: asyncio.TimerHandle | None = None

    def handle(self, message: TeleopMessage) -> None:
        """Handle a motion message.

        Raises:
            MessageError: If a value is not finite.
        """
        match message:
            case DriveCommand() | FollowPlan():
                self._move(message)
            case ReleaseControls():
                self.release(must_recentre=False)
            case PlanRequest() | SetSpeedLevel() | ClearPlan():
                self._handle_plan_message(message)

    def release(self, why: Reason | None = None, *, must_recentre: bool = True) -> None:
        """Stop the motion of the page if a control is held; every end of a motion is handled here.

        With `must_recentre`, the page must centre its controls before they act again; this is not
        needed if the page itself has released them. `why` is shown on the page.
        """
        self.navigation.pause()
        deadman = self._deadman
        was_held = deadman.force_release() if must_recentre else deadman.on_release()
        if was_held and self._lease_client.lease is not None:
            self._send_zero(self._lease_client.lease, ZERO_REPEATS, None)
        if was_held and why is not None:
            self._send_message(ControlsReleased(why=why))

    def close(self) -> None:
        """Stop the motion after the page has disconnected."""
        if self._watchdog is not None:
            self._watchdog.cancel()
        self.release(must_recentre=False)
        self.navigation.clear()

    def decide(self, robot_id: str, status: RobotStatus) -> None:
        """Handle a new status: release controls if the robot no longer moves, and plan at rest."""
        if status.mode not in DRIVABLE_MODES:
            self.release(status.why_no_drive)
        if self._stops[0] == robot_id and self._stops[1] != status.stops:
            # A stop can be shorter than the time between two states.
            self.release(because(Code.STOPPED_BY_ITSELF))
        self._stops = (robot_id, status.stops)
        if self._lease_client.lease is None:
            self.navigation.clear()
        self.navigation.update()

    def _move(self, message: DriveCommand | FollowPlan) -> None:
        """Send the command of a held control: stick, keys, gamepad, sliders or path.

        Raises:
            MessageError: If a value is not finite.
        """
        if isinstance(message, DriveCommand) and not all(map(math.isfinite, _twist(message))):
            raise MessageError("nonfinite", "a twist must be finite numbers")
        lease = self._lease_to_move()
        if lease is None:
            return
        try:
            if isinstance(message, DriveCommand):
                self.navigation.clear()  # Manual control ends path following.
                twist, frame = _twist(message), message.frame
            else:
                protocol, now_s = lease.protocol, time.monotonic()
                step = self.navigation.step(
                    lease.link, message.route, protocol.max_age_s, now_s, protocol.delay_s(now_s)
                )
                if step.phase is ExecutionPhase.ARRIVED:
                    self.release()  # The page sees the arrival and also releases.
                    return
                twist, frame = step.twist.tolist(), BASE
            self._send(lease, twist, frame, message.status_seq)
        except (PathError, ClientError) as error:
            self.release(reason_of(error))
            return
        if self._watchdog is None:
            self._start_watchdog(COMMAND_TIMEOUT_S)

    def _send(self, lease: Lease, twist: Sequence[float], frame: str, seen: int) -> int:
        """Send a command immediately, with `seen` as the number of the latest state seen."""
        if self._zeros is not None:
            self._zeros.cancel()
            self._zeros = None
        with lease.link.lock:
            command = lease.protocol.command(twist, frame, lease.link.now_s(), seen)
            lease.link.send(command)
        return command.seq

    def _send_zero(self, lease: Lease, left: int, first: int | None) -> None:
        """Send a zero, and repeat it every 20 ms until a status confirms it.

        The zero carries the number of the latest status here, so that the robot accepts it even if
        the page has seen only older ones. The bus may lose any command, and the command before the
        zero would otherwise remain active until it expires. Repetition stops with the next twist,
        when the lease ends, or after `ZERO_REPEATS`.
        """
        protocol = lease.protocol
        if not protocol.has_lease or (first is not None and protocol.has_counted(first)):
            return
        number = self._send(lease, ZERO_TWIST, BASE, lease.link.snapshot.status_seq)
        if left > 0:
            again = partial(self._send_zero, lease, left - 1, number if first is None else first)
            self._zeros = asyncio.get_running_loop().call_later(ZERO_PERIOD_S, again)

    def _handle_plan_message(self, message: PlanRequest | SetSpeedLevel | ClearPlan) -> None:
        lease = self._lease_client.lease
        match message:
            case PlanRequest() if lease is None:
                self.navigation.clear()
                self._send_message(ActionReply(to="plan", ok=False, why=_TAKE_CONTROL))
            case PlanRequest() if lease is not None:
                self.release(because(Code.PATH_REPLANNED))
                self.navigation.request_plan(lease.link, message)
            case SetSpeedLevel():
                self.navigation.set_speed_level(message.level)
            case _:
                if self.navigation.is_following:
                    self.release(because(Code.PATH_GIVEN_UP))
                self.navigation.clear()

    def _lease_to_move(self) -> Lease | None:
        """Record that a control is held; return the lease if it may move the robot."""
        lease = self._lease_client.lease
        if lease is None:
            if self._deadman.refuse_command():  # Held during a handover: must not start motion.
                self._send_message(ControlsReleased(why=_TAKE_CONTROL))
            return None
        if not self._deadman.on_command(time.monotonic()):
            return None
        max_age_s = lease.protocol.max_age_s
        if time.monotonic() - lease.link.snapshot.received_s > max_age_s:
            # The robot stops, and may be ready again before its next status arrives.
            self.release(because(Code.ROBOT_SILENT, s=max_age_s))
            return None
        status = lease.link.snapshot.status
        if status is None or status.mode not in DRIVABLE_MODES:
            # A control held while the robot becomes ready must not start motion.
            self.release(status.why_no_drive if status else because(Code.ROBOT_SILENT))
            return None
        return lease

    def _start_watchdog(self, wait_s: float) -> None:
        loop = asyncio.get_running_loop()
        self._watchdog = loop.call_later(wait_s, self._check_timeout)

    def _check_timeout(self) -> None:
        self._watchdog = None
        if self._deadman.state is not DeadmanState.HELD:
            return
        silent_s = self._deadman.silence_s(time.monotonic())
        if silent_s >= COMMAND_TIMEOUT_S:
            self.release(because(Code.PAGE_STALLED, s=COMMAND_TIMEOUT_S))
        else:
            self._start_watchdog(COMMAND_TIMEOUT_S - silent_s)


def _twist(message: DriveCommand) -> tuple[float, float, float]:
    return message.vx, message.vy, message.omega
