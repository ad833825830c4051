"""Robots and a router behind TLS and access rules on the loopback, with files of `tsd-certs`."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import queue
import threading
from collections.abc import Callable, Generator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec
import zenoh

from tests.support.robot_node import QUICK, URDF, matched, raw_session
from tests.support.withheld import PATIENCE_S
from tsd_twin import robots, security
from tsd_twin.bus import (
    Bus,
    Config,
    client_config,
    dialling_config,
    from_file,
    node_config,
    router_file,
)
from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.client.protocol import ControlProtocol
from tsd_twin.messages import topics
from tsd_twin.messages.services import (
    Description,
    HolderRequest,
    LeaseReply,
    LeaseRequest,
    Reply,
    decode_json,
)
from tsd_twin.messages.status import RobotStatus, decode_status
from tsd_twin.messages.topics import QoS, Sample, Service
from tsd_twin.node import RobotNode
from tsd_twin.security import Role
from tsd_twin.security.key_folder import KeyFolder, provision
from tsd_twin.security.router_keys import provision_router, robot_identity
from tsd_twin.security.router_rules import ALL, RobotRights
from tsd_twin.simulation import SimRobot

ID = "tsd"
TEXT = robots.read_description("tsd").replace("[motor]", "[motor]\narming_hold_s = 0.1", 1)
DESCRIPTION = Description(TEXT, "<robot/>")
PEOPLE = (
    security.client("alice", Role.OPERATOR),
    security.client("bob", Role.OPERATOR),
    security.client("guest", Role.VIEWER),
    security.client("camera", Role.SENSOR),
    security.client("tape", Role.RECORDER),
)
TELL = {
    "id": "tell",
    "permission": "allow",
    "flows": ["egress"],
    "messages": ["declare_subscriber", "declare_queryable"],
    "key_exprs": ["twin/**", "floor/**"],
}
"""Sends all declarations to clients.

A session publishes only on keys with a known subscriber, unlike a hostile program. With this rule
it also publishes forbidden messages."""


class Listener:
    """Records received samples and waits for them."""

    def __init__(self) -> None:
        self._heard: list[Sample] = []
        self._queue: queue.SimpleQueue[Sample] = queue.SimpleQueue()

    def __call__(self, sample: Sample) -> None:
        self._queue.put(sample)

    def until(self, wanted: Callable[[Sample], bool]) -> Sample:
        """Wait for the first sample that meets a condition."""
        while True:
            sample = self._queue.get(timeout=PATIENCE_S)
            self._heard.append(sample)
            if wanted(sample):
                return sample

    @property
    def heard(self) -> list[Sample]:
        """Return all received samples."""
        while not self._queue.empty():
            self._heard.append(self._queue.get())
        return self._heard


class SecuredRobot:
    """Robot with TLS, its key folder, and client sessions."""

    def __init__(self, folder: KeyFolder, *, told: bool = False, listen: str = "") -> None:
        self.folder = folder
        config = self.own_config()
        if told:
            rules = section(config, "access_control")
            names = [subject["id"] for subject in rules["subjects"]]
            rules["rules"].append(TELL)
            rules["policies"].append({"subjects": names, "rules": ["tell"]})
            config = with_sections(config, access_control=rules)
        if listen:
            config = with_sections(config, listen={"endpoints": [listen]})
        self.told = told
        self.bus = Bus(config)
        self.endpoint = self.bus.endpoints()[0]
        self._stop = threading.Event()
        robot = robots.parse_description(TEXT, "tsd.toml")
        node = RobotNode(self.bus, ID, robot, SimRobot(robot, seed=0, noise=0.0), DESCRIPTION)
        self._thread = threading.Thread(target=node.run, args=(self._stop,))
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join(PATIENCE_S)
        self.bus.close()

    @property
    def is_running(self) -> bool:
        return self._thread.is_alive()

    def own_config(self) -> Config:
        """Return the robot's configuration."""
        return from_file(str(self.folder.settings_file("robot")))

    def config(self, name: str, **changes: Any) -> Config:
        """Return a client's configuration for the robot's port."""
        config = from_file(str(self.folder.settings_file(name)))
        connect = section(config, "connect")
        connect["endpoints"] = [self.endpoint]
        return with_sections(config, connect=connect, **changes)

    @contextlib.contextmanager
    def join(self, name: str) -> Generator[Bus]:
        """Open the bus with a client's certificate and wait for the robot."""
        # Peers do not forward messages to other peers, so a hostile program is a client.
        with Bus(self.config(name, mode="client" if self.told else "peer")) as bus:
            alive = threading.Event()
            bus.subscribe_liveliness(topics.alive_key(ID), lambda _key, _lives: alive.set())
            assert alive.wait(PATIENCE_S)
            yield bus

    def raw_join(self, name: str) -> zenoh.Session:
        """Open a Zenoh session with a client's certificate."""
        return raw_session(self.config(name, mode="client" if self.told else "peer"))

    def force(self, bus: Bus, key: str, payload: bytes) -> None:
        """Put a forbidden message; the session sends it because of a known subscriber."""
        put(bus, key, payload, surely=self.told)

    def status(self, wanted: Callable[[RobotStatus], bool] = lambda _status: True) -> RobotStatus:
        """Wait at the robot for a status that meets a condition, and return it."""
        with listening(self.bus, topics.STATUS.key(ID)) as ear:
            sample = ear.until(lambda sample: wanted(decode_status(sample.payload)))
        return decode_status(sample.payload)


def put(bus: Bus, key: str, payload: bytes, surely: bool = True) -> None:
    """Put a message once the session has found a subscriber."""
    publisher = bus.publisher(key, QoS.DATA)
    if surely:
        matched(publisher)
    publisher.put(payload)
    publisher.close()


def ask(link: RobotMonitor, service: Service, message: msgspec.Struct) -> Reply:
    """Return the reply of a service."""
    answer = link.call(service, msgspec.json.encode(message), PATIENCE_S)
    return decode_json(answer or b"", Reply, "a reply")


def ask_lease(link: RobotMonitor, message: LeaseRequest) -> LeaseReply:
    """Return the reply of the lease service."""
    answer = link.call(Service.LEASE, msgspec.json.encode(message), PATIENCE_S)
    return decode_json(answer or b"", LeaseReply, "a reply")


def hold(link: RobotMonitor, operator: str) -> ControlProtocol:
    """Take control."""
    reply = ask_lease(link, LeaseRequest(op="acquire", operator=operator, take_over=True))
    assert reply.granted, reply
    protocol = ControlProtocol(link.id, link.robot, operator)
    protocol.grant(reply, link.now_s())
    return protocol


def set_free(bus: Bus) -> None:
    """Reset the robot and release its lease on an operator's bus."""
    link = RobotMonitor(bus, ID)
    lease = hold(link, "alice").lease_hex
    ask(link, Service.RESET, HolderRequest(lease))
    release = LeaseRequest(op="release", operator="alice", lease=lease)
    assert ask_lease(link, release).reason == "released"
    link.close()


@contextlib.contextmanager
def listening(bus: Bus, *keys: str) -> Generator[Listener]:
    """Subscribe to keys and record their samples."""
    ear = Listener()
    with contextlib.ExitStack() as stack:
        for key in keys:
            stack.callback(bus.subscribe(key, ear))
        yield ear


def section(config: Config, name: str) -> Any:
    """Return a section of a configuration."""
    return json.loads(config.parsed().get_json(name))


def with_sections(config: Config, **sections: Any) -> Config:
    """Return a configuration with replaced sections."""
    settings = zenoh.Config.from_json5(config.json5)
    for name, content in sections.items():
        settings.insert_json5(name, json.dumps(content))
    return dataclasses.replace(config, json5=str(settings))


def make_keys(path: Path, **changes: Any) -> KeyFolder:
    """Make a `tsd-certs` folder for a local robot on any port."""
    folder = KeyFolder(path)
    order = {
        "hosts": ("localhost", "127.0.0.1"),
        "identities": PEOPLE,
        "listen": "tls/127.0.0.1:0",
    }
    provision(
        folder,
        datetime.now(UTC),
        json.loads(node_config([]).json5),
        lambda endpoint: json.loads(client_config([endpoint]).json5),
        **(order | changes),
    )
    return folder


HERS, HIS = "lab1", "lab2"
"""Robots of Alice and Bob."""


def rights(use: str = "", watch: str = "") -> RobotRights:
    """Return rights for robots, separated by blanks."""
    return RobotRights(frozenset(use.split()), frozenset(watch.split()))


ROUTER_PEOPLE: dict[str, tuple[Role, RobotRights]] = {
    "alice": (Role.OPERATOR, rights(HERS)),
    "bob": (Role.OPERATOR, rights(HIS)),
    "gateway": (Role.OPERATOR, rights(ALL)),
    "guest": (Role.VIEWER, rights(HIS)),
    "mixed": (Role.OPERATOR, rights(HERS, HIS)),
    "camera": (Role.SENSOR, rights(HERS)),
    "eye": (Role.SENSOR, rights(ALL)),
    "tape": (Role.RECORDER, rights(HERS)),
}


def make_router_keys(path: Path, **changes: Any) -> KeyFolder:
    """Make a `tsd-certs` folder for a local router on any port."""
    folder = KeyFolder(path)
    order: dict[str, Any] = {
        "hosts": ("127.0.0.1",),
        "robots": [robot_identity(name) for name in (HERS, HIS)],
        "identities": [security.client(name, role) for name, (role, _) in ROUTER_PEOPLE.items()],
        "rights": {name: own for name, (_, own) in ROUTER_PEOPLE.items()},
        "listen": "tls/127.0.0.1:0",
    }
    provision_router(
        folder,
        datetime.now(UTC),
        json.loads(node_config([]).json5),
        lambda endpoint: json.loads(dialling_config([endpoint]).json5),
        **(order | changes),
    )
    return folder


class RouterStage:
    """Running router and its robots."""

    def __init__(self, folder: KeyFolder, *, told: bool = False) -> None:
        """With `told`, clients receive all declarations, and therefore send forbidden messages."""
        self.folder = folder
        config = router_file(str(folder.settings_file("router")))
        if told:
            rules = section(config, "access_control")
            names = [subject["id"] for subject in rules["subjects"]]
            rules["rules"].append(TELL)
            rules["policies"].append({"subjects": names, "rules": ["tell"]})
            config = with_sections(config, access_control=rules)
        self.router = Bus(config)
        (self.endpoint,) = self.router.endpoints()
        self.robots = {name: BehindRouter(self, name) for name in (HERS, HIS)}

    def config(self, name: str) -> Config:
        """Return the configuration of a robot or client for the router's port."""
        config = from_file(str(self.folder.settings_file(name)))
        connect = section(config, "connect")
        connect["endpoints"] = [self.endpoint]
        return with_sections(config, connect=connect)

    @contextlib.contextmanager
    def join(self, name: str, seen: str | None = None) -> Generator[Bus]:
        """Open a client session and wait until it sees robot `seen`."""
        with Bus(self.config(name)) as bus:
            if seen is not None:
                alive = threading.Event()
                bus.subscribe_liveliness(topics.alive_key(seen), lambda _key, _on: alive.set())
                assert alive.wait(PATIENCE_S)
            yield bus

    def raw_join(self, name: str) -> zenoh.Session:
        """Open a Zenoh session with the certificate of a robot or client."""
        return raw_session(self.config(name))

    def close(self) -> None:
        for robot in self.robots.values():
            robot.close()
        self.router.close()


class BehindRouter:
    """Robot node behind the router, with its session."""

    def __init__(self, stage: RouterStage, name: str) -> None:
        self.name = name
        self.bus = Bus(stage.config(name))
        robot = robots.parse_description(QUICK, name)
        node = RobotNode(self.bus, name, robot, SimRobot(robot), Description(QUICK, URDF))
        self._stop = threading.Event()
        self._thread = threading.Thread(target=node.run, args=(self._stop,), name=name)
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()
        self.bus.close()
