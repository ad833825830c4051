"""`cmd_vel` operator: decodes twists and decides when they move the robot (pure).

`cmd_vel` carries no lease, sequence number or echo, so the adapter acts as the operator: it
acquires the lease when a twist arrives and the robot is free, holds the latest twist for 0.2 s, and
does not reacquire a lost lease. The caller passes in messages and time, and performs the returned
actions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, StrEnum, auto
from typing import TypeAlias

import msgspec

from tsd_twin.messages.cdr import BASE, ODOM, decode_twist
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.ros_types import decode_cdr
from tsd_twin.messages.status import RobotStatus

TWIST, TWIST_STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
LARGEST = 100.0
"""Maximum component in m/s or rad/s; larger values suggest wrong units."""
MAX_AGE_S = 0.25
"""Twists that may be older than this on arrival are rejected."""
PAUSE_S = 0.5
"""Required pause (or a single zero) before twists held during a refusal are accepted."""
IDLE_S = 30.0
"""After this time without a twist or request, the robot is disarmed and the lease released."""
HELD_UP_S = 0.3
"""A longer gap between polls means that this process stalled and the robot has stopped."""
AT_REST_S = 0.3
"""Time without motion after which a request for control is granted."""
DISCOVERY_S = 2.0
"""Time to discover the publishers of a newly connected robot."""
NOTICE_INTERVAL_S = 2.0
"""Minimum interval between repeats of the same message."""
MUST_PAUSE = "cmd_vel moves the robot again after a pause, or a zero, or the service resume"
Objection: TypeAlias = tuple[str, str]
"""Why a twist is dropped: a keyword for rate-limited notices, and a sentence."""
_REST = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_DRIVABLE = frozenset({Mode.READY, Mode.DRIVING})


class _Vector(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


class _Twist(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    linear: _Vector = _Vector()
    angular: _Vector = _Vector()


class _Header(msgspec.Struct, frozen=True):
    frame_id: str = ""


class _TwistStamped(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    twist: _Twist
    header: _Header = _Header()


@dataclass(frozen=True, slots=True)
class CmdVel:
    """Received twist, not validated; components may be NaN."""

    twist: tuple[float, float, float, float, float, float]
    """(vx, vy, vz, wx, wy, wz), m/s and rad/s in `frame`."""
    frame: str = ""
    """`base_link`, `odom`, or "" for `base_link`."""

    @property
    def is_zero(self) -> bool:
        """Whether all components are zero."""
        return not any(self.twist)


def decode_cmd_vel(encoding: str, type_name: str, payload: bytes) -> CmdVel:
    """Decode a `geometry_msgs` Twist or TwistStamped in `cdr` or `json`.

    The stamp is ignored because clocks differ.

    Raises:
        MessageError: If the message is invalid (`shape`).
    """
    package, _, name = type_name.replace("/msg/", "/").partition("/")
    if package != "geometry_msgs" or name not in ("Twist", "TwistStamped"):
        raise MessageError("shape", f"cmd_vel is {TWIST} or {TWIST_STAMPED}, not '{type_name}'")
    stamped = name == "TwistStamped"
    if encoding == "cdr":
        if stamped:
            message = decode_twist(payload)
            vx, vy, vz, wx, wy, wz = message.twist.tolist()
            return CmdVel((vx, vy, vz, wx, wy, wz), message.frame)
        raw = decode_cdr(payload, TWIST)
        return _cmd_vel(raw.linear, raw.angular)
    if encoding == "json":
        try:
            if stamped:
                whole = msgspec.json.decode(payload, type=_TwistStamped)
                return _cmd_vel(whole.twist.linear, whole.twist.angular, whole.header.frame_id)
            twist = msgspec.json.decode(payload, type=_Twist)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise MessageError("shape", f"not a {name}: {error}") from error
        return _cmd_vel(twist.linear, twist.angular)
    raise MessageError("shape", f"cmd_vel is encoded as cdr or json, not '{encoding}'")


def _cmd_vel(linear: _Vector, angular: _Vector, frame: str = "") -> CmdVel:
    # CDR is decoded to rosbags messages, with the same fields.
    return CmdVel((linear.x, linear.y, linear.z, angular.x, angular.y, angular.z), frame)


class LeaseAction(Enum):
    """Action on the lease."""

    ACQUIRE = auto()
    """Acquire it, then call `acquired` or `denied`."""
    GIVE_BACK = auto()
    """Command zero, disarm and release it."""


@dataclass(frozen=True, slots=True)
class Drive:
    """Action: set a velocity for up to 0.2 s; on failure call `motion_failed` or `lost`."""

    twist: tuple[float, float, float, float, float, float]
    frame: str
    given_s: float | None
    """Earliest time of the publisher's input; None means now."""


@dataclass(frozen=True, slots=True)
class HandOver:
    """Action: transfer the lease to the requesting operator."""

    requester: str


Action: TypeAlias = LeaseAction | Drive | HandOver | str
"""A string is a notice to the publisher."""


class NoticeLimiter:
    """Limits notices about the same subject to one per `NOTICE_INTERVAL_S`."""

    def __init__(self) -> None:
        self._sent_s: dict[str, float] = {}

    def admits(self, about: str, now_s: float) -> bool:
        """Return whether to send a notice now."""
        # Operators have ids of any kind: only recent ones are kept.
        recent = {
            key: at_s for key, at_s in self._sent_s.items() if now_s - at_s < NOTICE_INTERVAL_S
        }
        self._sent_s = {about: now_s, **recent}
        return about not in recent


class State(StrEnum):
    """Lease state of the adapter."""

    FREE = "free"
    TAKING = "taking"
    """The lease is being acquired."""
    HELD = "held"
    LOST = "lost"
    """Taken by another operator or handed over; only the `arm` service reacquires it."""


class CmdVelOperator:
    """State machine for one `cmd_vel` publisher and one robot.

    Twists refused for a temporary reason, such as arming, stay refused afterwards until the
    publisher pauses or sends zero. The state survives reconnection: lost control stays lost when
    the robot returns.
    """

    def __init__(self, operator: str) -> None:
        """`operator` is the name used on the bus."""
        self.operator = operator
        self.max_age_s = MAX_AGE_S
        self.state = State.FREE
        self.dropped = 0
        """Number of rejected twists."""
        self._must_pause = False
        self._received_s = self._driven_s = self._used_s = self._not_before_s = -math.inf
        self._held_s = -math.inf
        self._polled_s = math.inf
        self._lost, self._was_lost = "", False
        self._notices = NoticeLimiter()

    def connected(self, now_s: float) -> list[Action]:
        """Handle a new or restored connection to the robot."""
        said = self.lost("the robot was out of reach", now_s)
        if self.state is State.TAKING:
            said = self.denied("the robot was out of reach", now_s)
        self.topic_opened(now_s)
        return said

    def topic_opened(self, now_s: float) -> None:
        """Handle (re)subscription to the topic, possibly under a new name.

        Twists held since before must not move the robot, even though they were not received.
        """
        self._must_pause, self._received_s = True, now_s + DISCOVERY_S - PAUSE_S

    # Twists.

    def on_twist(
        self,
        message: CmdVel,
        now_s: float,
        status: RobotStatus,
        sent_after_s: float | None = None,
        unproven: str = "",
    ) -> list[Action]:
        """Handle a twist received at `now_s`.

        `sent_after_s` is a lower bound on its send time on the same clock, or None if the transport
        has none. `unproven` is the reason why this bound is not yet reliable: the twist may then
        end a pause but not move the robot.
        """
        self._note_hold_up(now_s)
        paused = now_s - self._received_s >= PAUSE_S
        if refusal := self._refusal(message):
            return self._drop(now_s, *refusal)
        if message.is_zero:
            return self._rest(now_s)  # Accept it at any age, because it can only stop the robot.
        if obstacle := self._lateness(now_s, sent_after_s) or self._obstacle(status):
            return self._drop(now_s, *obstacle)
        self._received_s = now_s
        if self._must_pause and not paused:
            self.dropped += 1
            self._held_s = now_s
            return self._say(now_s, "pause", MUST_PAUSE)
        self._must_pause = False
        if unproven:
            self.dropped += 1
            return self._say(now_s, "unproven", unproven)
        if sent_after_s is not None and sent_after_s < self._not_before_s:
            self.dropped += 1
            return []  # Sent before the lease was granted or a request completed.
        if self.state is State.FREE:
            self.state = State.TAKING
            return [LeaseAction.ACQUIRE]
        if self.state is State.TAKING:
            return []
        self._driven_s = self._used_s = now_s
        return [Drive(message.twist, message.frame or BASE, sent_after_s)]

    def _note_hold_up(self, now_s: float) -> None:
        """Do not count a stall of this process as a pause of the publisher.

        Twists sent during the stall may be lost, so none of them need arrive late.
        """
        if now_s - self._polled_s > HELD_UP_S:
            self._must_pause, self._received_s = True, now_s

    def on_unread(self, now_s: float) -> None:
        """Handle a twist on an unassigned topic: if held, it must not move a robot later."""
        self._must_pause, self._received_s = True, now_s

    def waits_for_pause(self, now_s: float) -> bool:
        """Return whether twists are currently refused because their publisher did not pause."""
        return now_s - self._held_s < PAUSE_S

    def resume(self, now_s: float, status: RobotStatus) -> str:
        """Accept a held twist without a pause; return a reason if refused.

        For streaming controllers after a stall. The robot must be armed and at rest; the next
        refused twist requires a pause again.
        """
        obstacle = self._obstacle(status)
        reason = obstacle[1] if obstacle else ""
        if not reason and (status.mode != Mode.READY or now_s - self._driven_s < PAUSE_S):
            reason = f"resume works when the robot has been at rest for {PAUSE_S:g} s"
        if not reason:
            self._must_pause, self._held_s = False, -math.inf
            self._used_s = self._not_before_s = now_s
        return reason

    def _refusal(self, message: CmdVel) -> Objection | None:
        if not all(math.isfinite(number) for number in message.twist):
            return "not_finite", "cmd_vel has a number that is not finite: it is ignored"
        if any(abs(number) > LARGEST for number in message.twist):
            return "too_large", f"cmd_vel is beyond {LARGEST:g} m/s or rad/s: it is ignored"
        if message.frame not in ("", BASE, ODOM):
            text = f"cmd_vel in the frame '{message.frame}' is ignored: use {BASE} or {ODOM}"
            return "frame", text
        return None

    def _lateness(self, now_s: float, sent_after_s: float | None) -> Objection | None:
        if sent_after_s is None or now_s - sent_after_s <= self.max_age_s:
            return None
        # The publisher may have released the stick before a stalled link delivered this.
        return "late", "cmd_vel comes too late: the link has stalled, or is slow"

    def _obstacle(self, status: RobotStatus) -> Objection | None:
        """Return why a twist other than zero cannot move the robot now; None when it can."""
        if self.state is State.LOST:
            return "lost", f"{self._lost}; the service arm takes control again"
        holder = status.lease.holder
        if holder not in (None, self.operator):
            return f"held_by {holder}", f"{holder} has control: cmd_vel does not move the robot"
        if status.mode not in _DRIVABLE:
            reason = status.no_drive_reason
            text = f"{reason}: cmd_vel does not move the robot; call the service arm"
            return f"mode {status.mode}", text
        return None

    def _rest(self, now_s: float) -> list[Action]:
        """Handle a zero: end any motion without acquiring or keeping the lease."""
        self._must_pause = False
        in_motion = self.state is State.HELD and now_s - self._driven_s < AT_REST_S
        return [Drive(_REST, BASE, None)] if in_motion else []

    def _drop(self, now_s: float, about: str, text: str) -> list[Action]:
        self.dropped += 1
        self.on_unread(now_s)
        return self._say(now_s, about, text)

    def _say(self, now_s: float, about: str, text: str) -> list[Action]:
        return [text] if self._notices.admits(about, now_s) else []

    # The lease.

    def on_request(self, now_s: float) -> bool:
        """Handle a request that needs the lease; return whether to acquire it first.

        Twists held during the request must not move the robot afterwards. Requests are deliberate,
        so they also clear `LOST`.
        """
        self._must_pause, self._used_s = True, now_s
        self._received_s = min(self._received_s, now_s)  # Its publisher is known by now.
        if self.state is State.HELD:
            return False
        self._was_lost, self.state = self.state is State.LOST, State.TAKING
        return True

    def request_done(self, now_s: float) -> None:
        """Complete a request; reject twists that were sent before."""
        self._must_pause, self._used_s, self._not_before_s = True, now_s, now_s

    def acquired(self, now_s: float) -> None:
        """Handle a granted lease."""
        self.state, self._was_lost = State.HELD, False
        self._not_before_s = self._used_s = now_s

    def denied(self, reason: str, now_s: float) -> list[Action]:
        """Handle a denied lease."""
        self.state, self._must_pause = State.LOST if self._was_lost else State.FREE, True
        return self._say(now_s, "denied", reason)

    def lost(self, reason: str, now_s: float) -> list[Action]:
        """Handle the loss of the lease."""
        if self.state is not State.HELD:
            return []
        self.state, self._must_pause, self._lost = State.LOST, True, f"control is lost: {reason}"
        return self._say(now_s, "lost", f"{self._lost}; the service arm takes control again")

    def released(self) -> None:
        """Handle the release of the lease."""
        self.state, self._must_pause = State.FREE, True

    def motion_failed(self, reason: str, now_s: float) -> list[Action]:
        """Handle the end of a motion because the robot stopped automatically or is silent."""
        return self._drop(now_s, "motion_failed", reason)

    def poll(self, now_s: float, status: RobotStatus, conflict: str = "") -> list[Action]:
        """Return pending actions: handover or release of the lease.

        `conflict` is the reason why this adapter must not operate the robot, or "". The lease is
        released on a conflict, or if unused for `IDLE_S`. Call this several times per `HELD_UP_S`.
        """
        self._note_hold_up(now_s)
        self._polled_s = now_s
        if self.state is State.HELD and conflict:
            self.released()
            return [
                LeaseAction.GIVE_BACK,
                *self._say(now_s, "conflict", f"the robot is disarmed: {conflict}"),
            ]
        if self.state is not State.HELD or now_s - self._driven_s < AT_REST_S:
            return []
        asker = status.lease.requested_by
        if asker is not None and status.lease.holder == self.operator:
            self.state, self._must_pause = State.LOST, True
            self._lost = f"control was handed over to {asker}"
            return [HandOver(asker), *self._say(now_s, "handed_over", self._lost)]
        if now_s - self._used_s >= IDLE_S:
            self.released()
            text = f"no cmd_vel for {IDLE_S:g} s: the robot is disarmed, and control is released"
            return [LeaseAction.GIVE_BACK, *self._say(now_s, "idle", text)]
        return []
