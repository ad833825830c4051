"""Conversion of bus streams to ROS messages (pure)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from msgspec.structs import asdict

from tsd_twin.adapters.frames import (
    FOOTPRINT,
    IDENTITY,
    Transform,
    UrdfTree,
    WheelAngles,
    parse_urdf,
)
from tsd_twin.adapters.ros_topics import (
    ALTERNATIVE,
    BATTERY,
    DESCRIPTION,
    DIAGNOSTICS,
    EVENTS,
    JOINT_SETPOINTS,
    JOINT_STATES,
    ODOMETRY,
    SENSOR_POSE,
    SOURCES,
    STATUS,
    TF,
    TF_STATIC,
    TRUTH,
    RosNames,
    RosTopic,
)
from tsd_twin.lie import SO3
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import BASE, ODOM, decode_joints
from tsd_twin.messages.codes import Reason
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.events import Event
from tsd_twin.messages.modes import LATCHED, Mode
from tsd_twin.messages.ros_types import decode_cdr, encode_cdr, make_header, make_message, stamp_ns
from tsd_twin.messages.services import decode_json
from tsd_twin.messages.status import RobotStatus, decode_status
from tsd_twin.messages.topics import Topic
from tsd_twin.safety.loop_watch import LATE_S

_ODOMETRY = {topics.ODOM: ODOMETRY, topics.ODOM_ALTERNATIVE: ALTERNATIVE, topics.TRUTH: TRUTH}
_DIAGNOSTICS_EVERY_S = 1.0
_MESH = re.compile(r'(<mesh\s[^>]*?filename=")([^":]*)(")')


@dataclass(frozen=True, slots=True)
class RosMessage:
    """A message for one topic."""

    topic: RosTopic
    name: str
    """Absolute topic name."""
    payload: bytes
    """CDR payload."""


class RobotMapping:
    """Message conversion for one robot; keeps wheel angles and the latest stamp."""

    def __init__(
        self,
        robot: str,
        names: RosNames,
        urdf: str,
        mesh_uri: str,
        input_problem: Callable[[], str] = str,
    ) -> None:
        """`mesh_uri` is the prefix of mesh file names in the URDF.

        `input_problem` returns the reason why the robot ignores `cmd_vel`, or "".

        Raises:
            MessageError: If the URDF is invalid.
        """
        self.names = names
        self._robot = robot
        self._tree: UrdfTree = parse_urdf(urdf)
        self._urdf = _MESH.sub(rf"\g<1>{mesh_uri}\g<2>\g<3>", urdf)
        self._wheels = WheelAngles()
        self._stamp_ns = 0
        self._moved: list[tuple[Transform, int]] = []
        self._input_problem = input_problem
        self._diagnosed: tuple[str, str, int] = ("", "", 0)

    def static(self) -> list[RosMessage]:
        """Return the constant messages: URDF and fixed frames."""
        text = make_message("std_msgs/msg/String", data=self._urdf)
        fixed = self._tree.fixed
        if self._tree.ball is not None:  # The robot is stationary; only its sphere turns.
            fixed = [Transform(ODOM, FOOTPRINT, (0.0, 0.0, 0.0), IDENTITY), *fixed]
        return [
            self._message(DESCRIPTION, text),
            self._transforms(TF_STATIC, ((each, 0) for each in fixed)),
        ]

    def convert(
        self, topic: Topic, payload: bytes, wanted: Callable[[str], bool] = lambda _name: True
    ) -> Iterator[RosMessage]:
        """Convert a bus message to ROS messages for the `wanted` topics.

        Raises:
            MessageError: If the payload is invalid.
        """
        rows = [row for row in SOURCES.get(topic, ()) if wanted(self.names.topic(row.name))]
        if topic in _ODOMETRY:
            yield from self._odometry(topic, payload, rows)
        elif topic in (topics.JOINTS, topics.SETPOINT):
            yield from self._joints(topic, payload, rows)
        elif topic is topics.STATUS and rows:
            yield from self._status(payload, rows)
        elif topic is topics.EVENT and rows:
            yield self.event(decode_json(payload, Event, "an event"))
        elif topic is topics.SENSOR_POSE and rows:
            raw = decode_cdr(payload, SENSOR_POSE.type)
            raw.header.frame_id = self.names.frame(raw.header.frame_id)
            yield self._message(SENSOR_POSE, raw)

    # Poses and joints.

    def _odometry(
        self, topic: Topic, payload: bytes, rows: Sequence[RosTopic]
    ) -> Iterator[RosMessage]:
        raw = decode_cdr(payload, ODOMETRY.type)
        if topic is topics.ODOM:
            self._stamp_ns = stamp_ns(raw)
        at, turn = raw.pose.pose.position, raw.pose.pose.orientation
        numbers = (at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z)
        if not all(map(math.isfinite, numbers)):
            raise MessageError("nonfinite", "a pose must be finite numbers")
        position, quaternion = (at.x, at.y, at.z), (turn.w, turn.x, turn.y, turn.z)
        ball = self._tree.ball_frame
        if TF in rows:
            if ball is None:
                moved = [Transform(ODOM, FOOTPRINT, position, quaternion)]
            else:
                moved = self._tree.moving(self._tree.ring_angles(quaternion))
            at_ns, joints = stamp_ns(raw), self._moved
            self._moved = []
            yield self._transforms(TF, [*((each, at_ns) for each in moved), *joints])
        row = _ODOMETRY[topic]
        if row not in rows:
            return
        if ball is not None:
            # The bus uses base axes, ROS the axes of the child frame.
            spin = raw.twist.twist.angular
            base = SO3(np.array(quaternion)).inverse()
            spin.x, spin.y, spin.z = base.rotate(np.array([spin.x, spin.y, spin.z])).tolist()
        raw.header.frame_id = self.names.frame(ODOM)
        raw.child_frame_id = self.names.frame(ball or FOOTPRINT)
        yield self._message(row, raw)

    def _joints(
        self, topic: Topic, payload: bytes, rows: Sequence[RosTopic]
    ) -> Iterator[RosMessage]:
        joints = decode_joints(payload)
        measured = topic is topics.JOINTS
        position: Sequence[float] = joints.position_rad.tolist()
        velocity: Sequence[float] = joints.velocity_rad_per_s.tolist()
        angles = dict(zip(joints.names, position, strict=True))
        if measured:
            angles = self._wheels.update(joints.names, position, velocity, joints.stamp_ns)
        if TF in rows:
            # Send both in one message, because robots send their pose right after their joints.
            self._moved = [(each, joints.stamp_ns) for each in self._tree.moving(angles)]
        row = JOINT_STATES if measured else JOINT_SETPOINTS
        if row not in rows:
            return
        # Bus joints include sensors such as a gyro, which are not in the URDF.
        kept = [i for i, name in enumerate(joints.names) if name in self._tree.joints]
        names = [joints.names[i] for i in kept]
        yield self._message(
            row,
            make_message(
                row.type,
                header=make_header(joints.stamp_ns, self.names.frame(BASE)),
                name=names,
                position=np.array([angles[name] for name in names], dtype=np.float64),
                velocity=np.array([velocity[i] for i in kept], dtype=np.float64),
                effort=np.empty(0),
            ),
        )

    def _transforms(self, row: RosTopic, transforms: Iterable[tuple[Transform, int]]) -> RosMessage:
        stamped = [
            make_message(
                "geometry_msgs/msg/TransformStamped",
                header=make_header(at_ns, self.names.frame(each.parent)),
                child_frame_id=self.names.frame(each.child),
                transform=_transform(each),
            )
            for each, at_ns in transforms
        ]
        return self._message(row, make_message(row.type, transforms=stamped))

    # Status and events.

    def _status(self, payload: bytes, rows: Sequence[RosTopic]) -> Iterator[RosMessage]:
        status = decode_status(payload)
        if STATUS in rows:
            yield self._message(STATUS, make_message(STATUS.type, data=payload.decode()))
        if DIAGNOSTICS not in rows and BATTERY not in rows:
            return
        second = int(1e-9 * self._stamp_ns / _DIAGNOSTICS_EVERY_S)
        problem = self._input_problem()
        if self._diagnosed == (status.mode, problem, second):
            return
        self._diagnosed = (status.mode, problem, second)
        if DIAGNOSTICS in rows:
            yield self._diagnostics(status, problem)
        volts = _volts(status)
        if BATTERY in rows and volts is not None:
            yield self._battery(volts)

    def _diagnostics(self, status: RobotStatus, problem: str) -> RosMessage:
        array = make_message(
            DIAGNOSTICS.type,
            header=make_header(self._stamp_ns, ""),
            status=[
                make_message(
                    "diagnostic_msgs/msg/DiagnosticStatus",
                    level=level,
                    name=f"{self._robot}: {name}",
                    message=text,
                    hardware_id=self._robot,
                    values=[
                        make_message("diagnostic_msgs/msg/KeyValue", key=key, value=str(value))
                        for key, value in values.items()
                    ],
                )
                for name, level, text, values in diagnose(status, problem)
            ],
        )
        return self._message(DIAGNOSTICS, array)

    def _battery(self, volts: float) -> RosMessage:
        message = make_message(
            BATTERY.type,
            header=make_header(self._stamp_ns, self.names.frame(BASE)),
            voltage=volts,
            **dict.fromkeys(_UNMEASURED, math.nan),  # As BatteryState requires.
            **dict.fromkeys(_UNSPECIFIED, 0),
            present=True,
            cell_voltage=np.empty(0, dtype=np.float32),
            cell_temperature=np.empty(0, dtype=np.float32),
            location="",
            serial_number="",
        )
        return self._message(BATTERY, message)

    def event(self, event: Event) -> RosMessage:
        """Convert an event to a line of the log."""
        message = make_message(
            EVENTS.type,
            stamp=make_header(self._stamp_ns, "").stamp,
            level=_WARN if event.kind in _WARNINGS else _INFO,
            name=f"{self._robot}.{event.kind}",
            msg=event.text,
            file="",
            function=event.rule if event.why is None else event.why.code,
            line=0,
        )
        return self._message(EVENTS, message)

    def _message(self, row: RosTopic, message: Any) -> RosMessage:
        return RosMessage(row, self.names.topic(row.name), encode_cdr(message))


def _transform(each: Transform) -> Any:
    x, y, z = each.position_m
    w, qx, qy, qz = each.turn
    return make_message(
        "geometry_msgs/msg/Transform",
        translation=make_message("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
        rotation=make_message("geometry_msgs/msg/Quaternion", x=qx, y=qy, z=qz, w=w),
    )


_UNMEASURED = ("temperature", "current", "charge", "capacity", "design_capacity", "percentage")
_UNSPECIFIED = ("power_supply_status", "power_supply_health", "power_supply_technology")
"""Fields of `sensor_msgs/msg/BatteryState`."""
_INFO, _WARN = 20, 30
"""Levels of `rcl_interfaces/msg/Log`."""
_WARNINGS = frozenset({"adapter", "drop", "refusal", "consistency", "id", "loop"})
"""Kinds of events that are warnings."""


def _reason_values(prefix: str, why: Reason | None) -> dict[str, object]:
    """Code, parameters and cause of a reason, each under its key."""
    if why is None:
        return {}
    values = {f"{prefix}_{name}": value for name, value in why.params.items()}
    cause = _reason_values(f"{prefix}_cause", why.cause)
    return {f"{prefix}_code": why.code, **values, **cause}


OK, WARN, ERROR = 0, 1, 2
"""Levels of `diagnostic_msgs/msg/DiagnosticStatus`."""


def diagnose(
    status: RobotStatus, input_problem: str = ""
) -> list[tuple[str, int, str, dict[str, object]]]:
    """Return name, level, message and values of each diagnostic of a robot."""
    level = ERROR if status.mode == Mode.FAULT else WARN if status.mode in LATCHED else OK
    command, consistency, loop = status.command, status.consistency, status.loop
    mode = {"mode": status.mode, "holder": status.lease.holder or "", "stops": status.stops}
    counts = {f"dropped_{name}": count for name, count in asdict(command.dropped).items()}
    ages = {"age_s": command.age_s, "echo_s": command.echo_s, "counted": command.accepted}
    suspect = consistency.suspect
    disagrees = suspect is not None or consistency.level > 1.0
    agrees = f"{suspect or 'one of them'} contradicts the others" if disagrees else "consistent"
    residual = {"residual_mps": consistency.residual_mps, "level": consistency.level}
    late = WARN if loop.longest_ms >= LATE_S * 1000.0 else OK
    rate = f"{loop.hz:.0f} Hz, longest period {loop.longest_ms:.0f} ms"
    reason = _reason_values("stop", status.stop)
    found: list[tuple[str, int, str, dict[str, object]]] = [
        ("mode", level, status.stop_reason or status.mode, {**mode, **reason}),
        ("commands", OK, f"{command.accepted} counted", {**ages, **counts}),
        ("cmd_vel", ERROR if input_problem else OK, input_problem or "ok", {}),
        ("consistency", WARN if disagrees else OK, agrees, {**residual}),
        ("loop", late, rate, asdict(loop)),
    ]
    volts = _volts(status)
    if volts is not None:
        found.append(("battery", OK, f"{volts:.1f} V", {"voltage_v": volts}))
    return found


def _volts(status: RobotStatus) -> float | None:
    volts = status.hardware.get("battery_v")
    return float(volts) if isinstance(volts, int | float) and math.isfinite(volts) else None
