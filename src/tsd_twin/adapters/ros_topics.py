"""ROS topic table and ROS names of robots.

The table is the only definition of type, QoS and frame of each topic; the adapters,
docs/foxglove.md and docs/ros2.md use it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

from tsd_twin.adapters.frames import FOOTPRINT
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import BASE, ODOM
from tsd_twin.messages.topics import Topic


class RosQoS(StrEnum):
    """Quality of service of a ROS topic; history is KEEP_LAST."""

    SENSOR = "best effort, volatile, depth 5"
    STATE = "reliable, volatile, depth 10"
    LATCHED = "reliable, transient local, depth 1"
    COMMAND = "best effort, volatile, depth 1"
    """Accepts reliable publishers too, and never delivers old messages."""
    DRIVE = "reliable, volatile, depth 1"
    """Reaches reliable subscribers too, and resends only the latest message."""


@dataclass(frozen=True, slots=True)
class RosTopic:
    """Row of the topic table."""

    name: str
    """Relative to the robot's namespace, or absolute if shared by all robots, like `/tf`."""
    type: str
    qos: RosQoS
    source: str
    """Bus keys below `twin/<robot>/`."""
    frame: str = ""
    """`frame_id` and its contents."""


TF = RosTopic(
    "/tf", "tf2_msgs/msg/TFMessage", RosQoS.STATE, "state/odom, state/joints",
    f"{ODOM} to {FOOTPRINT}, and all joints that move",
)  # fmt: skip
TF_STATIC = RosTopic(
    "/tf_static", "tf2_msgs/msg/TFMessage", RosQoS.LATCHED, "desc",
    f"{FOOTPRINT} to {BASE}, and all fixed joints",
)  # fmt: skip
ODOMETRY = RosTopic(
    "odom", "nav_msgs/msg/Odometry", RosQoS.STATE, "state/odom", f"{ODOM} to {FOOTPRINT}"
)
ALTERNATIVE = RosTopic(
    "odom/alternative", "nav_msgs/msg/Odometry", RosQoS.STATE, "state/odom_alternative",
    f"{ODOM} to {FOOTPRINT}",
)  # fmt: skip
TRUTH = RosTopic(
    "odom/truth", "nav_msgs/msg/Odometry", RosQoS.STATE, "state/truth", f"{ODOM} to {FOOTPRINT}"
)
JOINT_STATES = RosTopic(
    "joint_states", "sensor_msgs/msg/JointState", RosQoS.STATE, "state/joints", BASE
)
JOINT_SETPOINTS = RosTopic(
    "joint_setpoints", "sensor_msgs/msg/JointState", RosQoS.STATE, "state/setpoint", BASE
)
DESCRIPTION = RosTopic("robot_description", "std_msgs/msg/String", RosQoS.LATCHED, "desc")
DIAGNOSTICS = RosTopic(
    "/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", RosQoS.STATE, "state/status"
)
BATTERY = RosTopic(
    "battery_state", "sensor_msgs/msg/BatteryState", RosQoS.SENSOR, "state/status", BASE
)
EVENTS = RosTopic("events", "rcl_interfaces/msg/Log", RosQoS.STATE, "event/*")
STATUS = RosTopic("status", "std_msgs/msg/String", RosQoS.STATE, "state/status")
SENSOR_POSE = RosTopic(
    "sensor_pose", "geometry_msgs/msg/PoseStamped", RosQoS.SENSOR, "sensor/pose", ODOM
)
PUBLISHED = (
    TF, TF_STATIC, ODOMETRY, ALTERNATIVE, TRUTH, JOINT_STATES, JOINT_SETPOINTS, DESCRIPTION,
    DIAGNOSTICS, BATTERY, EVENTS, STATUS, SENSOR_POSE,
)  # fmt: skip
"""Topics published by adapters."""
LATCHED_TOPICS = frozenset(row for row in PUBLISHED if row.qos is RosQoS.LATCHED)
"""Topics with a latest message for late subscribers."""
CMD_VEL = RosTopic(
    "cmd_vel", "geometry_msgs/msg/Twist", RosQoS.COMMAND, "cmd/*/twist", f"{BASE} or {ODOM}"
)
"""Subscribed topic; also accepts `geometry_msgs/msg/TwistStamped`."""
_POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
INITIAL_POSE = RosTopic("initialpose", _POSE, RosQoS.STATE, "srv/set_pose", ODOM)
MEASURED_POSE = RosTopic("measured_pose", _POSE, RosQoS.SENSOR, "sensor/pose", ODOM)
"""Measured pose from a sensor; republished as `sensor_pose`."""
READ = (CMD_VEL, INITIAL_POSE, MEASURED_POSE)
"""Topics subscribed to by a ROS adapter."""
DRIVEN = replace(CMD_VEL, qos=RosQoS.DRIVE, source="cmd/*/twist", frame=BASE)
"""Command topic of a third-party robot; optionally `geometry_msgs/msg/TwistStamped`."""
IMPORTED = (
    replace(ODOMETRY, qos=RosQoS.SENSOR),
    replace(JOINT_STATES, qos=RosQoS.SENSOR),
    DESCRIPTION,
)
"""Topics read from a third-party robot; best effort accepts reliable publishers too."""
SERVICES = ("arm", "disarm", "stop", "reset", "resume")
"""Services of type `std_srvs/srv/Trigger`, relative to the robot's namespace."""

SOURCES: Mapping[Topic, tuple[RosTopic, ...]] = {
    topics.ODOM: (ODOMETRY, TF),
    topics.ODOM_ALTERNATIVE: (ALTERNATIVE,),
    topics.TRUTH: (TRUTH,),
    topics.JOINTS: (JOINT_STATES, TF),
    topics.SETPOINT: (JOINT_SETPOINTS,),
    topics.STATUS: (STATUS, DIAGNOSTICS, BATTERY),
    topics.EVENT: (EVENTS,),
    topics.SENSOR_POSE: (SENSOR_POSE,),
}
"""Topics derived from each bus stream."""


@dataclass(frozen=True, slots=True)
class RosNames:
    """ROS names of a robot; namespaced if there are several robots."""

    namespace: str
    """Robot id as a valid ROS name."""
    shared: bool
    """Whether there are several robots, so that the namespace is used."""

    def topic(self, name: str) -> str:
        """Return the absolute name of a topic or service."""
        if name.startswith("/"):
            return name
        return f"/{self.namespace}/{name}" if self.shared else f"/{name}"

    def frame(self, name: str) -> str:
        """Return a frame id."""
        return f"{self.namespace}/{name}" if self.shared else name


def namespaces(robots: Iterable[str]) -> dict[str, RosNames]:
    """Return the names of all robots; ROS names start with a letter and contain no dash."""
    names: dict[str, RosNames] = {}
    used: set[str] = set()
    ids = sorted(robots)
    for robot in ids:
        word = robot.replace("-", "_")
        word = word if word[0].isalpha() else f"robot_{word}"
        while word in used:
            word += "_"
        used.add(word)
        names[robot] = RosNames(word, len(ids) > 1)
    return names
