"""Router with two robots and sessions of its clients, with the files that `tsd-certs` makes."""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Generator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tests.support.robot_node import PATIENCE_S, QUICK, URDF
from tests.support.secured_robot import TELL, section, with_sections
from tsd_twin import robots, security
from tsd_twin.bus import Bus, Config, dialling_config, from_file, node_config, router_file
from tsd_twin.messages import topics
from tsd_twin.messages.services import Description
from tsd_twin.node import RobotNode
from tsd_twin.security import Role
from tsd_twin.security.key_folder import KeyFolder
from tsd_twin.security.router_keys import provision_router, robot_identity
from tsd_twin.security.router_rules import ALL, RobotRights
from tsd_twin.simulation import SimRobot

HERS, HIS = "lab1", "lab2"
"""Robots of Alice and Bob."""


def rights(use: str = "", watch: str = "") -> RobotRights:
    """Return rights for robots that are separated by blanks."""
    return RobotRights(frozenset(use.split()), frozenset(watch.split()))


PEOPLE: dict[str, tuple[Role, RobotRights]] = {
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
    """Make a folder as `tsd-certs` does, for a router on this machine, on any port."""
    folder = KeyFolder(path)
    order: dict[str, Any] = {
        "hosts": ("127.0.0.1",),
        "robots": [robot_identity(name) for name in (HERS, HIS)],
        "identities": [security.client(name, role) for name, (role, _) in PEOPLE.items()],
        "rights": {name: own for name, (_, own) in PEOPLE.items()},
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
    """A running router and its robots."""

    def __init__(self, folder: KeyFolder, *, told: bool = False) -> None:
        """With `told`, clients learn of every subscriber, so that forbidden messages are sent."""
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
        """Return the configuration of a robot or client, for the port that the router has got."""
        config = from_file(str(self.folder.settings_file(name)))
        connect = section(config, "connect")
        connect["endpoints"] = [self.endpoint]
        return with_sections(config, connect=connect)

    @contextlib.contextmanager
    def join(self, name: str, seen: str | None = None) -> Generator[Bus]:
        """Open a session of a client, and wait until it sees robot `seen`."""
        with Bus(self.config(name)) as bus:
            if seen is not None:
                alive = threading.Event()
                bus.subscribe_liveliness(topics.alive_key(seen), lambda _key, _on: alive.set())
                assert alive.wait(PATIENCE_S)
            yield bus

    def close(self) -> None:
        for robot in self.robots.values():
            robot.close()
        self.router.close()


class BehindRouter:
    """Robot node with its session."""

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
