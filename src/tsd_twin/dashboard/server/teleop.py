"""Teleoperation by one page: dead-man switch, motion commands and the command watchdog."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import Any, TypeAlias

from tsd_twin.dashboard.server.lease import Lease, LeaseClient
from tsd_twin.dashboard.server.navigation import NavigationSession
from tsd_twin.dashboard.server.protocol import (
    ActionReply,
    ClearPlan,
    ControlsReleased,
    DriveCommand,
    FollowPlan,
    PlanRequest,
    ReleaseControls,
    SetSpeedLevel,
)
from tsd_twin.dashboard.server.send_queue import SendQueue
from tsd_twin.errors import MessageError, PathError
from tsd_twin.messages.ros import BASE
from tsd_twin.motion.tracking import ExecutionPhase
from tsd_twin.safety import Mode

COMMAND_TIMEOUT_S = 0.2
"""A page that sends no command for this long has released the controls."""


class DeadmanState(StrEnum):
    """State of the dead-man switch."""

    FREE = "free"
    """They are centred, or not touched."""
    HELD = "held"
    MUST_RECENTER = "spent"
    """The server has released them; the page must centre its controls before they act again."""


class DeadmanSwitch:
    """Dead-man switch: motion needs fresh commands; each end of motion is returned as True exactly
    once.
    """

    def __init__(self) -> None:
        self.state = DeadmanState.FREE
        self._commanded_s = 0.0

    def on_command(self, now_s: float) -> bool:
        """Process a motion command, and return whether it may be sent to the robot."""
        if self.state is DeadmanState.MUST_RECENTER:
            return False
        self.state, self._commanded_s = DeadmanState.HELD, now_s
        return True

    def on_release(self) -> bool:
        """Process that the page has centred its controls; return whether they were held."""
        was, self.state = self.state, DeadmanState.FREE
        return was is DeadmanState.HELD

    def force_release(self) -> bool:
        """Release on behalf of the page, which must centre its controls to drive again."""
        if self.state is not DeadmanState.HELD:
            return False
        self.state = DeadmanState.MUST_RECENTER
        return True

    def refuse_command(self) -> bool:
        """Refuse a command: the page must centre its controls first."""
        was, self.state = self.state, DeadmanState.MUST_RECENTER
        return was is not DeadmanState.MUST_RECENTER

    def silence_s(self, now_s: float) -> float:
        """Return the time since the newest command; 0 when no control is held."""
        return now_s - self._commanded_s if self.state is DeadmanState.HELD else 0.0


DRIVABLE_MODES = (Mode.READY, Mode.DRIVING)
"""Modes in which a held control moves the robot; in others the dashboard releases it. A robot that
comes to rest would drive on, but here only a control that is used anew moves it.
"""

TeleopMessage: TypeAlias = (
    DriveCommand | FollowPlan | ReleaseControls | PlanRequest | SetSpeedLevel | ClearPlan
)
"""Messages of a page that move the robot or plan its motion."""


class TeleopController:
    """Teleoperation of one page: stick and follow button share one dead-man switch; event loop
    only.
    """

    def __init__(
        self,
        lease_client: LeaseClient,
        send_queue: SendQueue,
        navigation: NavigationSession,
        send_message: Callable[[Any], None],
        release_controls: Callable[[str], None],
    ) -> None:
        """`release_controls` of the session calls ours, and notifies the page and the panel."""
        self.navigation = navigation
        self._lease_client = lease_client
        self._send_queue = send_queue
        self._send_message = send_message
        self._release_controls = release_controls
        self._deadman = DeadmanSwitch()
        self._watchdog: asyncio.TimerHandle | None = None

    def handle(self, message: TeleopMessage) -> None:
        """Handle a motion message.

        Raises:
            MessageError: it is no motion.
        """
        match message:
            case DriveCommand():
                self._drive(message)
            case FollowPlan():
                self._follow_plan(message)
            case ReleaseControls():
                self._release()
            case PlanRequest() | SetSpeedLevel() | ClearPlan():
                self._handle_plan_message(message)

    def release_controls(self, reason: str) -> bool:
        """Stop the motion on behalf of the page, and return whether it held a control."""
        self.navigation.pause()
        was_held = self._deadman.force_release()
        if was_held:
            if self._lease_client.lease is not None:
                self._lease_client.lease.send_zero()
            self._send_message(ControlsReleased(reason=reason))
        return was_held

    def close(self) -> None:
        """Stop the motion; the page has disconnected."""
        if self._watchdog is not None:
            self._watchdog.cancel()
        self._release()
        self.navigation.clear()

    def _drive(self, message: DriveCommand) -> None:
        twist = (message.vx, message.vy, message.omega)
        if not all(math.isfinite(value) for value in twist):
            raise MessageError("nonfinite", "a twist must be finite numbers")
        control = self._lease_to_move(message.seen)
        if control is not None:
            self.navigation.clear()  # Manual control ends path following.
            self._send_twist(control, twist, message.seen, message.frame)

    def _follow_plan(self, message: FollowPlan) -> None:
        control = self._lease_to_move(message.seen)
        if control is None:
            return
        try:
            link, now_s = control.link, time.monotonic()
            step = self.navigation.step(link, message.route, control.max_age_s, now_s)
        except PathError as error:
            self._release_controls(str(error))
            return
        if step.phase is ExecutionPhase.ARRIVED:
            self._deadman.force_release()  # The page sees the arrival, and releases as well.
            control.send_zero()
        else:
            self._send_twist(control, step.twist.tolist(), message.seen)

    def _handle_plan_message(self, message: PlanRequest | SetSpeedLevel | ClearPlan) -> None:
        control = self._lease_client.lease
        match message:
            case PlanRequest() if control is None:
                self._send_message(ActionReply(to="plan", ok=False, reason="take control first"))
            case PlanRequest() if control is not None:
                self._release_controls("another path is planned")
                self.navigation.request_plan(control.link, message)
            case SetSpeedLevel():
                self.navigation.set_speed_level(message.level)
            case _:
                if self.navigation.is_following:
                    self._release_controls("the path is given up")
                self.navigation.clear()

    def _lease_to_move(self, seen: int) -> Lease | None:
        """Register that a control is held, and return the lease to move the robot with, if
        allowed.
        """
        self._send_queue.acknowledge(seen)
        control = self._lease_client.lease
        if control is None:
            if (
                self._deadman.refuse_command()
            ):  # A control held during a hand-over must not start motion.
                self._send_message(ControlsReleased(reason="you do not have control"))
            return None
        if not self._deadman.on_command(time.monotonic()):
            return None
        if time.monotonic() - control.link.snapshot.received_s > control.max_age_s:
            # The robot stops meanwhile, and may be ready again before its next status arrives.
            self._release_controls(f"the robot has not been heard for {control.max_age_s:g} s")
            return None
        status = control.link.snapshot.status
        if status is None or status.mode not in DRIVABLE_MODES:
            # A control held while the robot becomes ready must not start motion.
            self._release_controls(status.no_drive_reason if status else "the robot is silent")
            return None
        return control

    def _send_twist(
        self, control: Lease, twist: Sequence[float], seen: int, frame: str = BASE
    ) -> None:
        control.send_twist(twist, seen, frame)
        if self._watchdog is None:
            self._start_watchdog(COMMAND_TIMEOUT_S)

    def _start_watchdog(self, wait_s: float) -> None:
        loop = asyncio.get_running_loop()
        self._watchdog = loop.call_later(wait_s, self._check_timeout)

    def _check_timeout(self) -> None:
        self._watchdog = None
        if self._deadman.state is not DeadmanState.HELD:
            return
        silent_s = self._deadman.silence_s(time.monotonic())
        if silent_s >= COMMAND_TIMEOUT_S:
            self._release_controls(
                f"no command from the page for {COMMAND_TIMEOUT_S * 1000:.0f} ms"
            )
        else:
            self._start_watchdog(COMMAND_TIMEOUT_S - silent_s)

    def _release(self) -> None:
        self.navigation.pause()
        if self._deadman.on_release() and self._lease_client.lease is not None:
            self._lease_client.lease.send_zero()
