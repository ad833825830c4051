"""ROS nodes that are not ours (`zenoh-ros2-sdk`), and a router as rmw_zenohd, for tests."""

from __future__ import annotations

import functools
import json
import math
import re
import struct
import threading
import time
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any

import zenoh
from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk.publisher import ROS2Publisher
from zenoh_ros2_sdk.qos import QosDurability, QosProfile
from zenoh_ros2_sdk.session import ZenohSession
from zenoh_ros2_sdk.subscriber import ROS2Subscriber
from zenoh_ros2_sdk.utils import compute_type_hash_from_msg

STORE = get_typestore(Stores.ROS2_JAZZY)
TWIST, TWIST_STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
TRIGGER_HASH = "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"
_GID = bytes(range(16))
PATIENCE_S = 60.0


@functools.cache
def definitions(type_name: str) -> tuple[str, dict[str, str]]:
    """Definition of a type as text, and those of the types in it."""
    whole = STORE.generate_msgdef(type_name, ros_version=2)[0]
    own, *others = re.split(r"={80}\nMSG: (\S+)\n", whole)
    names = [name.replace("/", "/msg/") if "/msg/" not in name else name for name in others[::2]]
    return own, dict(zip(names, others[1::2], strict=True))


def foreign_hash(type_name: str) -> str:
    """Hash of a type as the other implementation computes it."""
    return compute_type_hash_from_msg(type_name, *definitions(type_name))


@contextmanager
def ros_router() -> Generator[tuple[zenoh.Session, int]]:
    """A router as rmw_zenohd, and its port."""
    config = zenoh.Config()
    for key, value in {
        "mode": "router",
        "listen/endpoints": ["tcp/127.0.0.1:0"],
        "scouting/multicast/enabled": False,
        "adminspace/enabled": True,
    }.items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session:
        replies = session.get(f"@/{session.zid()}/router", timeout=5.0)
        found = [json.loads(each.ok.payload.to_string()) for each in replies if each.ok]
        yield session, int(found[0]["locators"][0].rpartition(":")[2])


def vector(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
    return STORE.types["geometry_msgs/msg/Vector3"](x, y, z)


def twist(vx_mps: float, vy_mps: float = 0.0, omega_rad_per_s: float = 0.0) -> Any:
    return STORE.types[TWIST](vector(vx_mps, vy_mps), vector(z=omega_rad_per_s))


def header(frame: str = "") -> Any:
    stamp = STORE.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    return STORE.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


class ForeignNode:
    """Publishers and subscribers of the other implementation, with the newest messages."""

    def __init__(self, router: zenoh.Session, port: int, domain: int = 0) -> None:
        self.router = router
        self._domain = domain
        self._port = port
        self.newest: dict[str, Any] = {}
        self.counted: Counter[str] = Counter()
        self.said: list[str] = []
        self._parts: list[Any] = []
        self._sequence = 0

    def close(self) -> None:
        for part in self._parts:
            part.close()

    def leave(self) -> None:
        """Close the session, which all nodes of a process share."""
        self.close()
        ZenohSession.get_instance("127.0.0.1", self._port).close()

    def publisher(self, topic: str, type_name: str) -> ROS2Publisher:
        made = ROS2Publisher(
            topic,
            type_name,
            self._whole(type_name),
            router_port=self._port,
            domain_id=self._domain,
            type_hash=foreign_hash(type_name),
        )
        self._parts.append(made)
        return made

    def subscribe(self, topic: str, type_name: str, *, latched: bool = False) -> None:
        durability = QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE
        self._parts.append(
            ROS2Subscriber(
                topic,
                type_name,
                functools.partial(self._take, topic),
                self._whole(type_name),
                router_port=self._port,
                domain_id=self._domain,
                type_hash=foreign_hash(type_name),
                qos=QosProfile(durability=durability),
            )
        )

    def _whole(self, type_name: str) -> str:
        return STORE.generate_msgdef(type_name, ros_version=2)[0]

    def _take(self, topic: str, message: Any) -> None:
        self.newest[topic] = message
        self.counted[topic] += 1
        if topic.endswith("/events"):
            self.said.append(message.msg)

    def until(self, condition: Callable[[], object], what: str) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end_s, f"{what}: {self.said}"
            assert "/status" not in self.newest or self.status["mode"] != "fault", self.said
            time.sleep(0.01)

    def until_all(self, *topics: str) -> None:
        self.until(lambda: all(self.counted[each] for each in topics), f"{topics}: {self.counted}")

    def tokens(self) -> list[str]:
        """All tokens of the graph, as a node asks for them."""
        found: list[str] = []
        complete = threading.Event()
        handler = zenoh.handlers.Callback(
            lambda reply: found.append(str(reply.ok.key_expr)), complete.set, indirect=False
        )
        self.router.liveliness().get(f"@ros2_lv/{self._domain}/**", handler, timeout=5.0)
        assert complete.wait(PATIENCE_S)
        return found

    def call(self, service: str) -> tuple[bool, str]:
        """Call a service, as the client of rmw_zenoh does, once the adapter offers it."""
        (answer,) = self.call_all(service)
        return answer

    def call_all(self, service: str) -> list[tuple[bool, str]]:
        """Call a service that several adapters may offer; return all their answers."""
        end_s = time.monotonic() + PATIENCE_S
        while not (found := self._ask(service)):
            assert time.monotonic() < end_s, f"no {service}: {self.said}"
            time.sleep(0.1)
        return [self._answer(each) for each in found]

    def _answer(self, sample: zenoh.Sample) -> tuple[bool, str]:
        sequence, source_ns, _, echoed = struct.unpack("<qqB16s", sample.attachment.to_bytes())
        assert (sequence, echoed) == (self._sequence, _GID)
        assert abs(time.time_ns() - source_ns) < 10**9
        body = sample.payload.to_bytes()
        return bool(body[4]), body[12:-1].decode()

    def _ask(self, service: str) -> list[zenoh.Sample]:
        self._sequence += 1
        replies = self.router.get(
            f"{self._domain}/{service.strip('/')}/std_srvs::srv::dds_::Trigger_/{TRIGGER_HASH}",
            payload=b"\0\1\0\0\0",
            attachment=struct.pack("<qqB16s", self._sequence, time.time_ns(), 16, _GID),
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=PATIENCE_S,
        )
        return [reply.ok for reply in replies if reply.ok is not None]

    @property
    def x_m(self) -> float:
        return self.newest["/odom/truth"].pose.pose.position.x

    @property
    def odom(self) -> tuple[float, float, float]:
        pose = self.newest["/odom"].pose.pose
        heading = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
        return pose.position.x, pose.position.y, heading

    @property
    def speed_mps(self) -> float:
        linear = self.newest["/odom/truth"].twist.twist.linear
        return math.hypot(linear.x, linear.y)

    @property
    def status(self) -> Any:
        return json.loads(self.newest["/status"].data)
