"""Drive a robot using only the table of keys, `eclipse-zenoh` and `rosbags`.

`python external_driver.py ENDPOINT ROBOT` takes control, arms, drives five figures, and prints the
result of each as a line of JSON. It deliberately imports no code of the project.
"""

from __future__ import annotations

import itertools
import json
import math
import struct
import sys
import threading
import time
from typing import Any

import zenoh
from rosbags.typesys import Stores, get_typestore

PATIENCE_S = 60.0
PERIOD_S = 0.02
LET_GO_S = 0.6
"""A fault can be reset only after this time without commands."""
FIGURES: dict[str, list[tuple[tuple[float, float, float], float]]] = {
    "straight": [((0.7, 0.0, 0.0), 0.7)],
    "strafe": [((0.0, 0.6, 0.0), 0.6)],
    "turn": [((0.0, 0.0, 1.5), 1.8)],
    "circle": [((0.6, 0.0, 2.5), 2.0 * math.pi)],
    "eight": [((0.6, 0.0, 2.5), 2.0 * math.pi), ((0.6, 0.0, -2.5), 2.0 * math.pi)],
}
"""Twists, each with its end: radians when turning, else metres."""
CONFIG = """{
  mode: "client", connect: {endpoints: ["%s"]},
  scouting: {multicast: {enabled: false}, gossip: {enabled: false}}
}"""

Pose = tuple[float, float, float]


class Robot:
    """Messages of a robot, and methods to command it."""

    def __init__(self, session: zenoh.Session, name: str) -> None:
        self._session, self._prefix = session, f"twin/{name}"
        self._types = get_typestore(Stores.ROS2_HUMBLE)
        self._news = threading.Condition()
        self._numbers = itertools.count(1)
        self._lease = ""
        self.leases = 0
        self.status: dict[str, Any] = {}
        self.status_seq = 0
        self.poses: dict[str, dict[int, Pose]] = {"odom": {}, "truth": {}}
        self.went_m = self.turned_rad = 0.0
        self._subscribers = [
            session.declare_subscriber(f"{self._prefix}/state/status", self._hear_status),
            session.declare_subscriber(f"{self._prefix}/state/odom", self._hear_pose),
            session.declare_subscriber(f"{self._prefix}/state/truth", self._hear_pose),
        ]
        self._command = session.declare_publisher(
            f"{self._prefix}/cmd/outsider/twist",
            priority=zenoh.Priority.REAL_TIME,
            express=True,
            congestion_control=zenoh.CongestionControl.DROP,
        )

    def _hear_status(self, sample: zenoh.Sample) -> None:
        with self._news:
            self.status = json.loads(sample.payload.to_bytes())
            self.status_seq, _ = struct.unpack("<Qq", sample.attachment.to_bytes())
            self._news.notify_all()

    def _hear_pose(self, sample: zenoh.Sample) -> None:
        _, robot_ns = struct.unpack("<Qq", sample.attachment.to_bytes())
        message = self._types.deserialize_cdr(sample.payload.to_bytes(), "nav_msgs/msg/Odometry")
        at, turn = message.pose.pose.position, message.pose.pose.orientation
        pose = (at.x, at.y, 2.0 * math.atan2(turn.z, turn.w))
        with self._news:
            poses = self.poses[str(sample.key_expr).rpartition("/")[2]]
            if poses and poses is self.poses["odom"]:
                step = seen_from(poses[max(poses)], pose)
                self.went_m += math.hypot(step[0], step[1])
                self.turned_rad += abs(step[2])
            poses[robot_ns] = pose

    def wait_for(self, mode: str) -> None:
        with self._news:
            if not self._news.wait_for(lambda: self.status.get("mode") == mode, PATIENCE_S):
                sys.exit(f"the robot is not {mode} but {self.status}")

    def ask(self, service: str, **fields: Any) -> dict[str, Any]:
        key, payload = f"{self._prefix}/srv/{service}", json.dumps(fields).encode()
        for reply in self._session.get(key, payload=payload, timeout=PATIENCE_S):
            if reply.ok is not None:
                return json.loads(reply.ok.payload.to_bytes())
        sys.exit(f"{key}: no answer")

    def get_ready(self) -> None:
        self._keep_control()
        if self.status["mode"] == "fault":
            time.sleep(LET_GO_S)
            self._demand("reset")
            self.wait_for("disarmed")
        if self.status["mode"] != "disarmed":
            return
        self._demand("arm")
        ready = threading.Event()

        def keep_control() -> None:
            while not ready.wait(0.3):
                self._keep_control()

        thread = threading.Thread(target=keep_control)
        thread.start()
        self.wait_for("ready")
        ready.set()
        thread.join()

    def _keep_control(self) -> None:
        """Renew or acquire control; acquire it again if a busy machine has lost it."""
        kept = self._lease and self.ask("lease", op="renew", operator="outsider", lease=self._lease)
        if not kept or not kept["granted"]:
            granted = self.ask("lease", op="acquire", operator="outsider")
            self._lease = granted["lease"] or sys.exit(granted["reason"])
            self.leases += 1

    def _demand(self, service: str) -> None:
        answer = self.ask(service, lease=self._lease)
        if not answer["ok"]:
            sys.exit(answer["reason"])

    def _drives(self) -> bool:
        """Return whether the robot obeys; a delay of 2 s loses control."""
        is_ours = self.status["lease"]["holder"] == "outsider"
        return is_ours and self.status["mode"] not in ("disarmed", "fault")

    def send(self, vx: float, vy: float, omega: float) -> None:
        make = self._types.types
        vector = make["geometry_msgs/msg/Vector3"]
        message = make["geometry_msgs/msg/TwistStamped"](
            header=make["std_msgs/msg/Header"](
                stamp=make["builtin_interfaces/msg/Time"](sec=0, nanosec=0), frame_id="base_link"
            ),
            twist=make["geometry_msgs/msg/Twist"](
                linear=vector(x=vx, y=vy, z=0.0), angular=vector(x=0.0, y=0.0, z=omega)
            ),
        )
        payload = bytes(self._types.serialize_cdr(message, "geometry_msgs/msg/TwistStamped"))
        lease = bytes.fromhex(self._lease)
        attachment = struct.pack("<Q16sQ", next(self._numbers), lease, self.status_seq)
        self._command.put(payload, attachment=attachment)

    def drive(self, legs: list[tuple[tuple[float, float, float], float]]) -> None:
        pause, give_up_s = threading.Event(), time.monotonic() + PATIENCE_S
        for twist, amount in legs:
            self.went_m = self.turned_rad = 0.0
            while (self.turned_rad if twist[2] else self.went_m) < amount:
                if not self._drives():
                    self.get_ready()
                self.send(*twist)
                pause.wait(PERIOD_S)
                if time.monotonic() > give_up_s:
                    sys.exit(f"the robot does not get there: {self.status}")
        while self.status["mode"] != "ready" and time.monotonic() < give_up_s:
            self.send(0.0, 0.0, 0.0)
            pause.wait(PERIOD_S)


def seen_from(start: Pose, pose: Pose) -> Pose:
    """A pose in the axes of another."""
    c, s = math.cos(start[2]), math.sin(start[2])
    dx, dy = pose[0] - start[0], pose[1] - start[1]
    turn = math.remainder(pose[2] - start[2], 2.0 * math.pi)
    return c * dx + s * dy, -s * dx + c * dy, turn


def outcome(odom: dict[int, Pose], truth: dict[int, Pose]) -> dict[str, Any]:
    """Compare estimate and truth at the same instants of the robot's clock."""
    times = sorted(odom.keys() & truth.keys())
    path_m = turned_rad = worst_m = worst_rad = 0.0
    end = (0.0, 0.0, 0.0)
    for before, now in itertools.pairwise(times):
        step = seen_from(truth[before], truth[now])
        path_m += math.hypot(step[0], step[1])
        turned_rad += abs(step[2])
        end = seen_from(truth[times[0]], truth[now])
        estimate = seen_from(odom[times[0]], odom[now])
        worst_m = max(worst_m, math.dist(end[:2], estimate[:2]))
        worst_rad = max(worst_rad, abs(math.remainder(end[2] - estimate[2], 2.0 * math.pi)))
    return {
        "samples": len(times),
        "path_m": path_m,
        "turned_rad": turned_rad,
        "end": end,
        "worst_m": worst_m,
        "worst_rad": worst_rad,
    }


def main() -> None:
    endpoint, name = sys.argv[1:]
    with zenoh.open(zenoh.Config.from_json5(CONFIG % endpoint)) as session:
        robot = Robot(session, name)
        robot.wait_for("disarmed")
        robot.get_ready()
        for figure, legs in FIGURES.items():
            robot.poses = {"odom": {}, "truth": {}}
            robot.drive(legs)
            result = outcome(robot.poses["odom"], robot.poses["truth"])
            print(json.dumps({"figure": figure} | result), flush=True)  # noqa: T201  Its output.
        dropped = robot.status["command"]["dropped"]
        ours = sorted(module for module in sys.modules if module.startswith("tsd"))
        end = {"dropped": dropped, "ours": ours, "leases": robot.leases}
        print(json.dumps(end), flush=True)  # noqa: T201  Its output.


if __name__ == "__main__":
    main()
