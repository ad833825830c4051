"""Third-party robot with ROS topics only, as the hardware of a local robot node.

The node enforces lease, arming, limits and timeouts. It sends commands as `cmd_vel` and reads the
latest `odom` and `joint_states`. Messages are aged from their send time, so delays in a stalled
link count.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np

from tsd_twin.adapters.cmd_vel import TWIST_STAMPED, NoticeLimiter
from tsd_twin.adapters.ros.arrivals import Origin, PublisherTracker
from tsd_twin.adapters.ros.port import UNKNOWN_PUBLISHER, Endpoints, Inbox, Received, RosPort
from tsd_twin.adapters.ros.shared_names import NameWatch
from tsd_twin.adapters.ros_messages import RosMessage
from tsd_twin.adapters.ros_topics import (
    DESCRIPTION,
    DRIVEN,
    IMPORTED,
    JOINT_STATES,
    ODOMETRY,
    RosNames,
    RosTopic,
)
from tsd_twin.errors import TwinError
from tsd_twin.lie import Array
from tsd_twin.messages.cdr import BASE
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.ros_types import (
    decode_cdr,
    encode_cdr,
    make_header,
    make_message,
    make_twist,
)
from tsd_twin.models.external_urdf import MOST_BYTES, geometry_toml, read_urdf, stand_in
from tsd_twin.models.links import roll_pitch_yaw
from tsd_twin.robots import ExternalDescription, parse_description
from tsd_twin.robots.external import ExternalGeometry
from tsd_twin.safety import Heartbeat

_LOG = logging.getLogger(__name__)
NODE = "tsd_import"
"""ROS node name."""
SEND_EVERY_S = 0.02
"""Period of `cmd_vel` while driving."""
ZEROS = 25
"""Number of zeros after a motion, before going silent to let other nodes drive."""
HELD_S = 0.25
"""Longest loop pause after which the current motion still continues."""
_LAST_ZEROS, _LAST_PAUSE_S = 5, 0.01
"""Zeros at program exit."""
_LARGEST_JOINTS = 16_384
"""Maximum size of `joint_states` in bytes, about 250 joints."""
_WAITING = 16
"""Queue size per topic; the oldest messages are dropped."""
_UNSENT_S = 1.0
"""Duration of a fault after a failed send."""
_MAX_COORDINATE_M = 1e6
_FASTEST = 100.0
"""Maximum plausible speed, in m/s or rad/s."""
_UNIT = 0.01
"""Tolerance on the length of a quaternion."""


def endpoints(*, stamped: bool) -> Endpoints:
    """Return the endpoints for a third-party robot; `stamped` selects `TwistStamped`."""
    driven = replace(DRIVEN, type=TWIST_STAMPED) if stamped else DRIVEN
    return Endpoints(NODE, (driven,), IMPORTED)


@dataclass(frozen=True, slots=True)
class ExternalLimits:
    """Limits of a third-party robot."""

    speed_mps: float = 0.5
    turn_rate_rad_per_s: float = 1.0
    acceleration_mps2: float = 0.5
    sideways: bool = False


def describe(name: str, urdf: str, limits: ExternalLimits) -> str:
    """Return the description of a robot with the shape in `urdf`, which may be "".

    Raises:
        RobotFileError: If the limits are not plausible.
    """
    try:
        shape, said = read_urdf(urdf) if urdf else stand_in("robot_description has not come")
        text = _toml(name, shape, said, limits)
        parse_description(text, "robot_description")
    except MessageError as error:
        shape, said = stand_in(f"robot_description cannot be used ({error})")
    except TwinError as error:
        shape, said = stand_in(f"robot_description is not plausible ({error})")
    else:
        return text
    text = _toml(name, shape, said, limits)
    parse_description(text, "the limits")
    return text


def _toml(name: str, shape: ExternalGeometry, said: tuple[str, ...], limits: ExternalLimits) -> str:
    speed, acceleration = limits.speed_mps, limits.acceleration_mps2
    drives = "It drives in all directions." if limits.sideways else (
        "Driving sideways: it cannot, so that part of a command has no effect."
    )  # fmt: skip
    # Large enough not to lower the speed limit.
    allowance_m = min(100.0, speed * 0.6 + speed * speed / (2.0 * acceleration))
    assumptions = said if limits.sideways else (drives, *said)
    encoded = [msgspec.json.encode(_plain(sentence)).decode() for sentence in assumptions]
    return f"""name = "{name}"
title = "{name}, by ROS"
assumptions = [{", ".join(encoded)}]

[limits]
speed_mps = {speed!r}
turn_rate_rad_per_s = {limits.turn_rate_rad_per_s!r}
acceleration_mps2 = {acceleration!r}
deceleration_mps2 = {acceleration!r}
angular_acceleration_rad_per_s2 = {2.0 * limits.turn_rate_rad_per_s!r}
stop_allowance_m = {round(allowance_m, 3)!r}

[battery] # Not measured.
nominal_v = 12.0

[drive]
kind = "imported"
{geometry_toml(msgspec.structs.replace(shape, sideways=limits.sideways))}"""


def _plain(sentence: str) -> str:
    """Remove characters with a special meaning in TOML or terminals, and truncate."""
    return "".join(c if c.isprintable() else "?" for c in sentence)[:300]


class ExternalRobot:
    """RobotIO of a third-party robot, and receiver of its topics.

    The middleware calls `on_message` on its own threads, which only enqueues; all other methods are
    called from the node's loop.
    """

    def __init__(
        self,
        open_port: Callable[[ExternalRobot], RosPort],
        names: RosNames,
        odom_timeout_s: float,
        *,
        stamped: bool = False,
        description_s: float = 5.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Wait for `robot_description`, at most `description_s`.

        `clock` must be the one that `now_s` of the methods below comes from.

        Raises:
            TwinError: If the port cannot be opened.
        """
        self._names = names
        self._clock = clock
        self._timeout_s = odom_timeout_s
        self._driven = endpoints(stamped=stamped).published[0]
        self._inbox = Inbox(dict.fromkeys(IMPORTED, _WAITING))
        self._arrivals = {row.name: PublisherTracker() for row in IMPORTED}
        self._described = threading.Event()
        self._notices = NoticeLimiter()
        self._problem: tuple[str, str] | None = None
        self.urdf = ""
        """Content of `robot_description`, or "" if it did not arrive in time."""
        self._robot: ExternalDescription | None = None
        self._columns: Mapping[str, int] = {}
        self._measured = np.zeros(0)
        self._odom_s = -math.inf
        """Send time of the latest odometry, on our clock."""
        self._odom_from: bytes = b""
        self._counted = {row.name: 0 for row in IMPORTED}
        self._dropped = 0
        self._sent, self._sent_s, self._zeros = 0, -math.inf, 0
        self._written_s, self._size, self._cut = -math.inf, 0.0, False
        self._heartbeat = Heartbeat(False, 0)
        self._unsent: Reason | None = None
        self._unsent_s = -math.inf
        self._closed = False
        self._port = open_port(self)
        self._shared = NameWatch(self._port, names, is_shown=False)
        self._described.wait(description_s)
        for received in self._inbox.take([DESCRIPTION]):
            self._describe(received)

    def configure(self, robot: ExternalDescription) -> None:
        """Set the description; call before the first `read`."""
        self._robot = robot
        joints = (*robot.kinematics().joints, *robot.sensors)
        self._columns = {joint.name: i for i, joint in enumerate(joints)}
        self._measured = np.zeros(len(joints))

    # On middleware threads.

    def on_message(self, row: RosTopic, type_name: str, payload: bytes, origin: Origin) -> None:
        """Queue a message for the loop."""
        self._inbox.put(Received(row, type_name, payload, origin, self._clock()))
        if row.name == DESCRIPTION.name:
            self._described.set()

    def on_unreadable(self, name: str, reason: str) -> None:
        """Count an invalid message."""
        self._dropped += 1
        self._problem = (name, f"a message of {name} is ignored: {reason}"[:200])

    def on_call(self, service: str, answer: Callable[[bool, str], None]) -> None:  # noqa: ARG002  Interface.
        """Refuse; there are no services."""
        answer(False, "there is no such service")

    # On the node's loop.

    def read(self, now_s: float) -> Array | None:
        """Return speeds, pose and joints, or None if odometry is too old."""
        for received in self._inbox.take(IMPORTED):
            try:
                self._receive(received, now_s)
            except MessageError as error:
                self.on_unreadable(received.row.name, str(error))
        if self._problem is not None:
            about, text = self._problem
            if self._notices.admits(about, now_s):
                _LOG.warning("%s", text)
            self._problem = None
        return None if self._is_silent(now_s) else self._measured.copy()

    def write(self, setpoint: Array, now_s: float) -> None:
        """Publish the twist while non-zero, then several zeros, then nothing.

        If this process stalled, the robot may have stopped automatically. Finishing the braking
        ramp would move it again, so zeros are sent instead.
        """
        assert self._robot is not None  # noqa: S101  Configured first.
        twist = self._robot.kinematics().forward(setpoint).twist
        was_s, self._written_s = self._written_s, now_s
        size, before = float(np.abs(twist).max()), self._size
        self._size = size
        if size > 0.0 and now_s - was_s > HELD_S:
            self._cut = True
        elif size == 0.0 or size > before:
            self._cut = False
        if size > 0.0 and not self._cut:
            # Half a period early corresponds to one loop period.
            if now_s - self._sent_s > 0.75 * SEND_EVERY_S or not self._zeros:
                self._publish(twist, now_s)
            self._zeros = ZEROS
        elif self._zeros == ZEROS or (self._zeros and now_s - self._sent_s > 0.75 * SEND_EVERY_S):
            self._publish(np.zeros(3), now_s)
            self._zeros -= 1

    def set_heartbeat(self, heartbeat: Heartbeat) -> None:
        """Send zeros on disarming and on each stop.

        On a stop this also applies while disarmed, because other nodes may drive the robot.
        """
        before, self._heartbeat = self._heartbeat, heartbeat
        if (before.armed and not heartbeat.armed) or (heartbeat.latched and not before.latched):
            self._zeros = ZEROS

    def fault(self, now_s: float) -> Reason | None:
        """Return a fault for missing odometry, failed sends or a duplicate name."""
        if problem := self._shared.problem(now_s):
            return problem
        if now_s - self._unsent_s < _UNSENT_S:
            return self._unsent
        if not self._is_silent(now_s):
            return None
        topic = self._names.topic(ODOMETRY.name)
        if self._odom_s == -math.inf:
            return because(Code.NO_ODOMETRY, topic=topic)
        return because(Code.ODOMETRY_OLD, topic=topic, s=self._timeout_s)

    def hardware(self) -> Mapping[str, Any]:
        """Return the hardware part of the status."""
        age_s = self._clock() - self._odom_s
        return {
            "kind": "ros",
            "odom_age_s": round(age_s, 2) if math.isfinite(age_s) else None,
            "received": dict(self._counted),
            "ignored": self._dropped,
            "sent": self._sent,
        }

    def close(self) -> None:
        """Send zeros if it was recently driven, and leave the graph."""
        if self._closed:
            return
        self._closed = True
        if self._zeros:
            for _ in range(_LAST_ZEROS):
                self._publish(np.zeros(3), self._clock())
                time.sleep(_LAST_PAUSE_S)
        self._port.close()

    def _is_silent(self, now_s: float) -> bool:
        return now_s - self._odom_s > self._timeout_s

    def _receive(self, received: Received, now_s: float) -> None:
        name = received.row.name
        arrival = self._arrivals[name].note(received.origin, received.arrived_s)
        if arrival is None:
            self._dropped += 1  # Duplicate or reordered.
        elif arrival.sent_after_s == -math.inf:
            raise MessageError("clock", "the clock of its publisher has jumped")
        elif name == ODOMETRY.name:
            self._take_odometry(received, arrival.sent_after_s, now_s)
        elif name == JOINT_STATES.name:
            self._take_joints(received)
        else:
            self._describe(received)

    def _take_odometry(self, received: Received, sent_s: float, now_s: float) -> None:
        publisher = received.origin.publisher
        if publisher == UNKNOWN_PUBLISHER:
            raise MessageError("publishers", "it has several publishers: end all but one")
        if publisher != self._odom_from and not self._is_silent(now_s):
            raise MessageError("publishers", "it has a second publisher, which is not followed")
        raw = decode_cdr(received.payload, ODOMETRY.type)
        at, turn = raw.pose.pose.position, raw.pose.pose.orientation
        linear, angular = raw.twist.twist.linear, raw.twist.twist.angular
        _, _, heading = roll_pitch_yaw((turn.w, turn.x, turn.y, turn.z))
        numbers = (at.x, at.y, heading, linear.x, linear.y, angular.z)
        length = math.hypot(turn.w, turn.x, turn.y, turn.z)
        # Comparisons with NaN are false.
        if not abs(length - 1.0) <= _UNIT:
            raise MessageError("quaternion", "its orientation is no unit quaternion")
        if not all(abs(number) <= _MAX_COORDINATE_M for number in numbers[:2]):
            raise MessageError("nonfinite", "its position is no place")
        if not all(abs(number) <= _FASTEST for number in numbers[3:]):
            raise MessageError("nonfinite", "its speed is none")
        self._odom_from, self._odom_s = publisher, sent_s
        self._counted[ODOMETRY.name] += 1
        speeds = {"vx": linear.x, "vy": linear.y, "omega": angular.z}
        pose = {"odom_x_m": at.x, "odom_y_m": at.y, "odom_heading_rad": heading}
        for name, value in (speeds | pose).items():
            if name in self._columns:
                self._measured[self._columns[name]] = value

    def _take_joints(self, received: Received) -> None:
        raw = decode_cdr(received.payload, JOINT_STATES.type, _LARGEST_JOINTS)
        if len(raw.position) != len(raw.name):
            return  # Only efforts or speeds.
        self._counted[JOINT_STATES.name] += 1
        for name, position in zip(raw.name, raw.position.tolist(), strict=True):
            column = self._columns.get(name)
            # Drive joints come from odometry; no ROS joint shares their names.
            is_own = column is not None and column > self._columns["odom_heading_rad"]
            if is_own and abs(position) <= _MAX_COORDINATE_M:
                self._measured[column] = position

    def _describe(self, received: Received) -> None:
        try:
            raw = decode_cdr(received.payload, DESCRIPTION.type, MOST_BYTES + 64)
        except MessageError as error:
            self.on_unreadable(DESCRIPTION.name, str(error))
            return
        self._counted[DESCRIPTION.name] += 1
        if self._robot is None:
            self.urdf = raw.data
        elif raw.data != self.urdf:
            changed = "robot_description has changed: start tsd-ros again to draw it"
            self._problem = ("changed", changed)

    def _publish(self, twist: Array, now_s: float) -> None:
        vx, vy, omega = twist.tolist()
        message = make_twist((vx, vy, 0.0, 0.0, 0.0, omega))
        if self._driven.type == TWIST_STAMPED:
            header = make_header(time.time_ns(), BASE)
            message = make_message(TWIST_STAMPED, header=header, twist=message)
        name = self._names.topic(self._driven.name)
        try:
            self._port.publish(RosMessage(self._driven, name, encode_cdr(message)))
        except TwinError as error:
            self._unsent = because(Code.CMD_VEL_UNSENT, text=str(error))
            self._unsent_s = now_s
        self._sent += 1
        self._sent_s = now_s
