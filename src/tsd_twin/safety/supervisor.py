"""Safety supervisor: modes, arming, driving, stopping, latched stop and watchdog heartbeat."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.commands import Command
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.events import Event
from tsd_twin.messages.modes import ARMED, LATCHED, Mode
from tsd_twin.messages.names import OperatorNames
from tsd_twin.messages.sentences import sentence
from tsd_twin.messages.services import LeaseReply, LeaseRequest, Reply, StopRequest
from tsd_twin.messages.status import ArmingStatus
from tsd_twin.messages.topics import Sample
from tsd_twin.robots import RobotDescription
from tsd_twin.safety.command_gate import CommandGate
from tsd_twin.safety.lease import Lease, LeaseEvents, LeaseHandover, LeaseManager, is_held_by
from tsd_twin.safety.loop_watch import LoopWatch

TRANSITIONS: dict[tuple[Mode, Mode], str] = {
    (Mode.DISARMED, Mode.ARMING): "arm",
    (Mode.ARMING, Mode.READY): "wheels at speed",
    (Mode.ARMING, Mode.DISARMED): "disarm, no operator, or not neutral",
    (Mode.READY, Mode.DRIVING): "counted non-zero command",
    (Mode.READY, Mode.DISARMED): "disarm, or no operator for 10 s",
    (Mode.DRIVING, Mode.READY): "counted zero command, and at rest",
    (Mode.DRIVING, Mode.STOPPING): "no counted command in time, control lost, or disarm",
    (Mode.STOPPING, Mode.DRIVING): "counted command",
    (Mode.STOPPING, Mode.READY): "at rest",
    (Mode.STOPPING, Mode.DISARMED): "at rest, after disarm",
    (Mode.STOPPED, Mode.DISARMED): "reset",
    (Mode.FAULT, Mode.DISARMED): "reset",
    **{(mode, Mode.STOPPED): "stop" for mode in Mode if mode is not Mode.STOPPED},
    **{(mode, Mode.FAULT): "fault" for mode in ARMED},
}
"""All allowed mode transitions with their triggers."""


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """Heartbeat sent with each setpoint, for hardware with a command watchdog."""

    armed: bool
    """Whether the wheels may spin."""
    counter: int
    """Heartbeat counter; the board trips if it stops incrementing.
    While the robot moves, only accepted commands and the start of a controlled stop increment it.
    At rest with spinning wheels, every step increments it; the supervisor ends that mode after 10 s
    without an operator."""
    latched: bool = False
    """Whether a stop or fault is latched."""
    stopped: bool = False
    """Whether a stop is latched, which must also block other command sources."""


NO_OPERATOR_TIMEOUT_S = 10.0
"""The wheels spin down after this time without a lease."""
RESET_HOLDOFF_S = 0.5
"""Time after the last non-zero command before a reset is accepted."""
NEUTRAL_S = 1.0
"""Arming timeout for the gimbals to reach neutral tilt."""
SPIN_UP_S = 5.0
"""Arming timeout for the wheels to reach their speed."""
_DRIVE_REFUSALS = {
    Mode.DISARMED: because(Code.ARM_FIRST),
    Mode.ARMING: because(Code.STILL_ARMING),
    Mode.STOPPING: because(Code.COMING_TO_REST),
    Mode.STOPPED: because(Code.RESET_FIRST, mode=Mode.STOPPED.value),
    Mode.FAULT: because(Code.RESET_FIRST, mode=Mode.FAULT.value),
}
"""Reasons for refusing motion, by mode."""
_LOST = because(Code.CONTROL_LOST)
_REPORT_S = 0.2
"""Minimum interval between events of a rule about drops or refusals."""


class SafetySupervisor:
    """Safety state machine of a robot: modes, lease, command gate and latched stop."""

    def __init__(self, robot: RobotDescription, new_lease_id: Callable[[], bytes]) -> None:
        self.mode = Mode.DISARMED
        self.why: Reason | None = None
        """Reason why the robot stopped, is stopping or was disarmed."""
        self.gate = CommandGate()
        self.loop = LoopWatch()
        self.command: Command | None = None
        """Latest accepted command since the robot last came to rest."""
        self.command_s = -np.inf
        self.command_seq = 0
        self.stops = 0
        """Number of controlled stops initiated by the robot."""
        self.operators = OperatorNames()
        """Display names of the operators heard last."""
        self._leases = LeaseManager(robot, new_lease_id)
        self._lease_events = LeaseEvents(self._leases)
        self._driving_lease: bytes = b""
        self._command_expires_s = -np.inf
        """Expiry time of the latest command."""
        self._fresh_s = -np.inf
        """Arrival time of the latest command within the maximum age."""
        self._echo_ends_first = False
        """Whether that command expires by echo age rather than by timeout."""
        self._hold_s = robot.arming_hold_s
        self._since_s = 0.0
        self._operator_seen_s = -np.inf
        self._last_nonzero_command_s = -np.inf
        self._spin_up_s: float | None = None
        self._disarm_at_rest = False
        self._heartbeat_count = 0
        self._fault: Reason | None = None
        self._reported_s: dict[tuple[str, str], float] = {}
        self._events: list[Event] = []

    @property
    def reason(self) -> str:
        """Text of `why`, "" without one."""
        return sentence(self.why) if self.why else ""

    # Operator requests.

    def lease(self, request: LeaseRequest, now_s: float) -> LeaseReply:
        """Process a lease request; a change of holder stops the robot."""
        before = self._leases.current(now_s)
        reply = self._leases.answer(request, now_s)
        after = self._leases.current(now_s)
        if after is not None:
            self._operator_seen_s = now_s
        if reply.done:  # A refused request may use the id of another operator.
            self.operators.learn(request.operator, request.name)
        if after is not before and self.mode is Mode.DRIVING:
            # Not in the next step, because a command of the new holder may arrive first.
            self._transition(Mode.STOPPING, _LOST, now_s)
        if changed := self._lease_events.after(request, before, now_s):
            if request.op in ("request", "withdraw"):  # Any operator may send these at any rate.
                self._report_now_and_then("lease", changed, request.op, now_s)
            else:
                self._report("lease", changed, "lease", now_s)
        elif reply.why is not None and not reply.done and request.op != "peek":
            self.refuse(request.op, reply.why, now_s)
        return reply

    def arm(self, lease_hex: str, now_s: float) -> Reply:
        """Start arming; requires the lease and mode `disarmed`."""
        if refusal := self.arm_refusal(lease_hex, now_s):
            return self.refuse("arm", refusal, now_s)
        self._transition(Mode.ARMING, because(Code.ARMED_BY_OPERATOR), now_s)
        return Reply(True)

    def disarm(self, lease_hex: str, now_s: float) -> Reply:
        """Spin down: immediately at rest, else after a controlled stop."""
        if refusal := self.holder_refusal(lease_hex, now_s):
            return self.refuse("disarm", refusal, now_s)
        reason = because(Code.DISARMED_BY_OPERATOR)
        if self.mode in (Mode.ARMING, Mode.READY):
            self._transition(Mode.DISARMED, reason, now_s)
        elif self.mode in (Mode.DRIVING, Mode.STOPPING):
            self._disarm_at_rest = True
            if self.mode is Mode.DRIVING:
                self._transition(Mode.STOPPING, reason, now_s)
        return Reply(True)

    def stop(self, request: StopRequest, now_s: float) -> Reply:
        """Latch a stop; open to all clients at any time, without a lease."""
        self.operators.learn(request.operator, request.name, replace=False)
        if self.mode is not Mode.STOPPED:
            before = self.why if self.mode is Mode.FAULT else None
            self._transition(Mode.STOPPED, _stop_reason(request, before), now_s)
        return Reply(True)

    def reset(self, lease_hex: str, now_s: float) -> Reply:
        """Clear a latched stop or fault; the next mode is always `disarmed`."""
        if refusal := self.reset_refusal(lease_hex, now_s):
            return self.refuse("reset", refusal, now_s)
        self._transition(Mode.DISARMED, because(Code.RESET_BY_OPERATOR), now_s)
        return Reply(True)

    def refuse(self, request: str, why: Reason, now_s: float) -> Reply:
        """Return a refusal and report it as a rate-limited event."""
        refused = because(Code.REQUEST_REFUSED, why, request=request)
        self._report_now_and_then("refusal", refused, request, now_s)
        return Reply.refused(why)

    # Refusals. Requests are decided by these functions, and the status shows their results, so that
    # both agree. Each returns why a request made now is refused, or None.

    def lease_refusal(self, operator: str | None, now_s: float) -> Reason | None:
        """Refusal of acquiring the lease as `operator` without a take-over.

        None represents any operator without a reservation.
        """
        return self._leases.acquire_refusal(operator, now_s, take_over=False)

    def holder_refusal(self, lease_hex: str, now_s: float) -> Reason | None:
        """Refusal of any request that requires the lease, and of disarming."""
        lease = self._leases.current(now_s)
        if is_held_by(lease, None, lease_hex):
            return None
        if lease is None:
            return because(Code.TAKE_CONTROL_FIRST)
        return because(Code.HELD_BY, holder=lease.holder)

    def arm_refusal(self, lease_hex: str, now_s: float) -> Reason | None:
        """Refusal of arming."""
        if refusal := self.holder_refusal(lease_hex, now_s) or self.latched_refusal:
            return refusal
        if self.mode is Mode.DISARMED:
            return self._fault
        return because(Code.WRONG_MODE, mode=self.mode.value)

    def reset_refusal(self, lease_hex: str, now_s: float) -> Reason | None:
        """Refusal of a reset."""
        if refusal := self.holder_refusal(lease_hex, now_s):
            return refusal
        if self.mode not in LATCHED:
            return because(Code.NOT_LATCHED, mode=self.mode.value)
        if now_s - self._last_nonzero_command_s < RESET_HOLDOFF_S:
            return because(Code.RELEASE_FIRST)
        return None

    def drive_refusal(self, lease_hex: str, now_s: float) -> Reason | None:
        """Refusal of motion: non-zero commands are accepted but do not move the robot."""
        if refusal := self.holder_refusal(lease_hex, now_s):
            return refusal
        if self.mode in (Mode.READY, Mode.DRIVING):
            return None
        # A new holder starts from standstill, not from the previous holder's motion.
        goes_on = self.mode is Mode.STOPPING and lease_hex == self._driving_lease.hex()
        return None if goes_on and not self._disarm_at_rest else _DRIVE_REFUSALS[self.mode]

    @property
    def latched_refusal(self) -> Reason | None:
        """Refusal of requests that need a reset first."""
        return _DRIVE_REFUSALS[self.mode] if self.mode in LATCHED else None

    # Called by the control loop.

    def receive(self, sample: Sample, now_s: float) -> None:
        """Process a command sample from the bus: accept it, or reject and count it."""
        lease = self._leases.current(now_s)
        outcome = self.gate.validate(sample, lease, now_s)
        if isinstance(outcome, MessageError):
            dropped = because(Code.COMMAND_DROPPED, outcome.why)
            self._report_now_and_then("drop", dropped, outcome.reason, now_s)
            return
        if lease is not None and not self.gate.is_stale_zero:
            # A stale zero stops the robot but does not prove that the sender is connected.
            self._leases.renew(now_s)
            self._heartbeat_count += 1
            oldest_s = self.gate.echoed_s + lease.max_age_s
            self._command_expires_s = min(now_s + lease.timeout_s, oldest_s)
            self._fresh_s, self._echo_ends_first = now_s, oldest_s < now_s + lease.timeout_s
        self.command_s, self.command_seq = now_s, outcome.seq
        if outcome.twist.any():
            self._last_nonzero_command_s = now_s
            refusal = self.drive_refusal(outcome.lease.hex(), now_s)
            if self.mode is not Mode.DRIVING and not refusal:
                self._transition(Mode.DRIVING, None, now_s)
        if self.mode is Mode.DRIVING:
            self.command = outcome

    def step(
        self, now_s: float, *, neutral: bool, at_speed: bool, at_rest: bool, fault: Reason | None
    ) -> None:
        """Advance the state machine to `now_s`: expire leases and commands, and change modes.

        Args:
            now_s: Start of the period.
            neutral: Whether all gimbals are at neutral tilt; used while arming only.
            at_speed: Whether all wheels have reached their setpoint; used while arming only.
            at_rest: Whether the commanded twist is zero.
            fault: Fault of the hardware or the joints, or None.
        """
        lease = self._watch_lease(now_s)
        self._fault = fault
        if fault is not None and self.mode in ARMED:
            self._transition(Mode.FAULT, fault, now_s)
        unattended = now_s - self._operator_seen_s >= NO_OPERATOR_TIMEOUT_S
        if unattended and self.mode in (Mode.ARMING, Mode.READY):
            why = because(Code.UNATTENDED, s=NO_OPERATOR_TIMEOUT_S)
            self._transition(Mode.DISARMED, why, now_s)
        match self.mode:
            case Mode.ARMING:
                self._step_arming(now_s, neutral=neutral, at_speed=at_speed)
            case Mode.DRIVING:
                self._step_driving(lease, now_s, at_rest=at_rest)
            case Mode.STOPPING:
                if at_rest:
                    self._transition(
                        Mode.DISARMED if self._disarm_at_rest else Mode.READY, self.why, now_s
                    )
            case Mode.DISARMED | Mode.READY | Mode.STOPPED | Mode.FAULT:
                pass
        if self.mode in (Mode.ARMING, Mode.READY):
            self._heartbeat_count += 1

    def arming(self, now_s: float) -> ArmingStatus | None:
        """Return the progress of arming, or None in other modes."""
        if self.mode is not Mode.ARMING:
            return None
        if self._spin_up_s is not None:
            return ArmingStatus("spin_up", min(1.0, (now_s - self._spin_up_s) / SPIN_UP_S))
        return ArmingStatus("hold", min(1.0, (now_s - self._since_s) / max(self._hold_s, 1e-9)))

    @property
    def wheels_spin(self) -> bool:
        """Whether the drive motors are commanded to spin."""
        if self.mode is Mode.ARMING:
            return self._spin_up_s is not None
        return self.mode in ARMED

    @property
    def heartbeat(self) -> Heartbeat:
        """Heartbeat for the hardware watchdog."""
        return Heartbeat(
            self.mode in ARMED,
            self._heartbeat_count,
            latched=self.mode in LATCHED,
            stopped=self.mode is Mode.STOPPED,
        )

    def lease_in_force(self, now_s: float) -> Lease | None:
        """Return the active lease, if any."""
        return self._leases.current(now_s)

    @property
    def hand_over(self) -> LeaseHandover:
        """Pending request and reservation of the lease."""
        return self._leases.hand_over

    def take_events(self) -> list[Event]:
        """Return the events since the last call."""
        events, self._events = self._events, []
        return events

    # Private.

    def _watch_lease(self, now_s: float) -> Lease | None:
        lease = self._leases.current(now_s)
        if lease is not None:
            self._operator_seen_s = now_s
        if expired := self._lease_events.expiry_event(now_s):
            self._report("lease", expired, "lease", now_s)
        return lease

    def _step_arming(self, now_s: float, *, neutral: bool, at_speed: bool) -> None:
        if self._spin_up_s is None:
            waited_s = now_s - self._since_s
            if not neutral and waited_s >= NEUTRAL_S:
                self._transition(Mode.DISARMED, because(Code.NOT_NEUTRAL), now_s)
            elif neutral and waited_s >= self._hold_s:
                self._spin_up_s = now_s
        elif at_speed:
            self._transition(Mode.READY, None, now_s)
        elif now_s - self._spin_up_s >= SPIN_UP_S:
            self._transition(Mode.DISARMED, because(Code.NOT_AT_SPEED), now_s)

    def _step_driving(self, lease: Lease | None, now_s: float, *, at_rest: bool) -> None:
        if lease is None or self.command is None or lease.id != self.command.lease:
            self._transition(Mode.STOPPING, _LOST, now_s)
            return
        if now_s > self._command_expires_s:
            self._transition(Mode.STOPPING, self._why_no_command_stands(lease, now_s), now_s)
        elif at_rest and not self.command.twist.any():
            self._transition(Mode.READY, None, now_s)

    def _transition(self, mode: Mode, why: Reason | None, now_s: float) -> None:
        if (self.mode, mode) not in TRANSITIONS:
            raise AssertionError(f"there is no transition from {self.mode} to {mode}")
        before, self.mode, self.why, self._since_s = self.mode, mode, why, now_s
        self._spin_up_s = None
        if mode is Mode.STOPPING:
            self.stops += 1
            self._driving_lease = self.command.lease if self.command is not None else b""
            self._heartbeat_count += 1
        else:
            self._disarm_at_rest = False
        if mode is not Mode.DRIVING:
            self.command = None
        goes_on = mode is Mode.DRIVING or (mode is Mode.READY and before is not Mode.ARMING)
        if not goes_on:
            self.gate.reject_sent_before(now_s)
        changed = because(Code.MODE_CHANGED, why, before=before.value, after=mode.value)
        self._report("mode", changed, TRANSITIONS[before, mode], now_s)

    def _why_no_command_stands(self, lease: Lease, now_s: float) -> Reason:
        if self.gate.is_overaged:
            return self._based_on(self.gate.overaged_s, lease, now_s)
        if self._echo_ends_first:
            return self._based_on(self.gate.echoed_s, lease, now_s)
        return self.loop.explains(self._fresh_s, lease.timeout_s, now_s) or because(
            Code.NO_COMMAND,
            ms=1000.0 * (now_s - self._fresh_s),
            limit_ms=1000.0 * lease.timeout_s,
        )

    def _based_on(self, echoed_s: float | None, lease: Lease, now_s: float) -> Reason:
        limit_ms = 1000.0 * lease.max_age_s
        if echoed_s is None:
            return because(Code.ECHO_UNKNOWN, limit_ms=limit_ms)
        return self.loop.explains(echoed_s, lease.max_age_s, now_s) or because(
            Code.ECHO_TOO_OLD, ms=1000.0 * (now_s - echoed_s), limit_ms=limit_ms
        )

    def _report_now_and_then(self, kind: str, why: Reason, rule: str, now_s: float) -> None:
        if now_s - self._reported_s.get((kind, rule), -np.inf) >= _REPORT_S:
            self._reported_s[kind, rule] = now_s
            self._report(kind, why, rule, now_s)

    def _report(self, kind: str, why: Reason, rule: str, now_s: float) -> None:
        self._events.append(Event.of(kind, why, rule, now_s))


def _stop_reason(request: StopRequest, before: Reason | None) -> Reason:
    """Reason for a stop; `before` is the fault in which it was requested."""
    by = {"by": request.operator} if request.operator else {}
    if request.reason:
        return because(Code.STOP_WITH_TEXT, before, text=request.reason, **by)
    return because(Code.STOP_REQUESTED, before, **by)
