"""Per-robot rights in a router, tested by raw Zenoh sessions with each certificate."""

from __future__ import annotations

import dataclasses
import shutil
import time
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tests.support.robot_node import matched
from tests.support.secured_robot import (
    HERS,
    HIS,
    Listener,
    RouterStage,
    listening,
    make_router_keys,
    put,
    rights,
)
from tests.support.withheld import PATIENCE_S
from tsd_twin import security
from tsd_twin.bus import Bus, from_file
from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.messages import topics
from tsd_twin.messages.pictures import CameraName
from tsd_twin.messages.status import RobotStatus, decode_status
from tsd_twin.messages.topics import QoS, Service
from tsd_twin.security import Role
from tsd_twin.security.key_folder import KeyFolder
from tsd_twin.security.router_rules import ALL

pytestmark = pytest.mark.system

SECRET = b"from another robot"
PICTURES, FLOOR = CameraName("front", HIS).key, CameraName("ceiling").key
KEYS = [*(topic.key(HIS).replace("*", "bob") for topic in topics.TOPICS), PICTURES]
"""One key per topic of Bob's robot, including its camera."""
PATTERNS = [
    f"twin/{HIS}/**",
    "twin/*/state/**",
    "twin/*/event/*",
    "twin/*/cmd/**",
    "twin/*/stop",
    "twin/*/camera/**",
    f"twin/{HIS[:-1]}$*/state/**",
    f"twin/$*{HIS[-1]}/**",
    "twin/**",
    "**",
]
TOKENS = [
    topics.alive_key(HIS),
    topics.alive_key("*"),
    topics.instance_key(HIS, "*"),
    topics.instance_key("*", "*"),
    f"twin/{HIS}/event/*/@adv/**",
    "twin/*/event/*/@adv/**",
    "twin/**",
    "**",
]
SERVICES = [service.key(HIS) for service in Service]
SELECTORS = [
    *SERVICES,
    *(f"twin/*/{service}" for service in Service),
    f"twin/{HIS}/event/*/@adv/**",
    f"twin/{HIS}/**",
    "twin/*/**",
    "**",
]
ADMIN = ["@/*/**", "@/**", "@/*/router", "@/*/*/config/**"]


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Generator[RouterStage]:
    it = RouterStage(make_router_keys(tmp_path_factory.mktemp("router") / "keys"))
    yield it
    it.close()


@pytest.fixture(scope="module")
def telling(tmp_path_factory: pytest.TempPathFactory) -> Generator[RouterStage]:
    it = RouterStage(make_router_keys(tmp_path_factory.mktemp("telling") / "keys"), told=True)
    yield it
    it.close()


def publish_everything(bob: Bus, robot: Bus) -> None:
    """Publish on each key of Bob's robot with sufficient rights; the robot publishes as well."""
    for topic in topics.TOPICS:
        key = topic.key(HIS).replace("*", "bob")
        sender = bob if topic in (topics.TWIST, topics.STOP) else robot
        sender.publisher(key, QoS.DATA).put(SECRET)
    robot.publisher(PICTURES, QoS.DATA).put(SECRET)


def status_after(ear: Listener, robot: str, since_s: float) -> RobotStatus:
    """Return a status of a robot from after a time."""
    ear.until(lambda s: s.key == topics.STATUS.key(robot) and time.monotonic() > since_s)
    return decode_status(ear.heard[-1].payload)


@pytest.mark.parametrize("name", ["alice", "camera", "tape"])
def test_no_subscription_shows_another_robot(stage: RouterStage, name: str) -> None:
    with (
        stage.join(name, HERS) as own,
        stage.join("gateway", HIS) as gateway,
        stage.join("bob", HIS) as bob,
        listening(own, *KEYS, *PATTERNS) as seen,
        listening(own, topics.STATUS.key(HERS)) as hers,
        listening(gateway, "twin/*/state/**", "twin/*/event/*", "twin/*/camera/**") as everything,
    ):
        everything.until(lambda sample: sample.key == topics.ODOM.key(HIS))
        publish_everything(bob, stage.robots[HIS].bus)
        everything.until(lambda sample: sample.key == PICTURES)
        for _ in range(3):  # They arrive at 20 Hz in the same session.
            hers.until(lambda _: True)
    assert {sample.key.split("/")[1] for sample in seen.heard} == {HERS}


def test_a_robot_that_is_not_followed_sends_only_summaries_through_the_router(
    stage: RouterStage,
) -> None:
    robot = stage.robots[HIS].bus
    states = {topic for topic in topics.TOPICS if topic.path.startswith("state/")}
    puts = {topic: robot.publisher(topic.key(HIS), QoS.DATA) for topic in states}

    def wanted() -> set[topics.Topic]:
        return {topic for topic, each in puts.items() if each.has_subscribers}

    def poll_until(condition: Callable[[], bool], *, streaming: bool) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end_s, wanted()
            link.set_streaming(streaming)
            link.poll(time.monotonic())
            time.sleep(0.01)

    with stage.join("gateway", HIS) as gateway:
        link = RobotMonitor(gateway, HIS)
        poll_until(lambda: wanted() == {topics.SUMMARY}, streaming=False)
        poll_until(lambda: link.snapshot.in_summary, streaming=False)
        known = link.snapshot
        assert None not in (known.joints, known.setpoint, known.odom, known.truth, known.status)
        poll_until(lambda: wanted() == states, streaming=True)
    for publisher in puts.values():
        publisher.close()


def test_pictures_of_the_floor_are_from_sensors_of_all_robots_for_those_who_may_watch_all(
    telling: RouterStage,
) -> None:
    with (
        telling.join("eye") as eye,
        telling.join("camera") as camera,
        telling.join("gateway", HIS) as gateway,
        telling.join("mixed", HIS) as mixed,
        listening(telling.robots[HERS].bus, topics.SENSOR_POSE.key(HERS)) as at_hers,
        listening(mixed, "floor/**", "twin/*/state/status") as limited,
        listening(gateway, "floor/**") as seen,
    ):
        put(camera, FLOOR, SECRET)
        put(camera, topics.SENSOR_POSE.key(HERS), b"end")
        at_hers.until(lambda sample: sample.payload == b"end")
        put(eye, FLOOR, b"the floor")
        seen.until(lambda sample: sample.payload == b"the floor")
        for _ in range(3):
            limited.until(lambda sample: sample.key == topics.STATUS.key(HIS))
    assert SECRET not in {sample.payload for sample in seen.heard}
    assert FLOOR not in {sample.key for sample in limited.heard}


def test_clocks_of_cameras_are_for_those_who_see_their_pictures(telling: RouterStage) -> None:
    with (
        telling.join("eye") as eye,
        telling.join("camera") as camera,
        telling.join("gateway", HIS) as gateway,
        telling.join("mixed", HIS) as mixed,
        telling.join("alice", HERS) as alice,
    ):
        clocks = [f"{key}/clock" for key in (PICTURES, FLOOR)]
        for key in clocks:
            camera.serve(key, lambda query: query.reply(SECRET))
        camera.query(Service.DESC.key(HERS), b"")  # The router has handled what came before.
        for key in clocks:
            eye.serve(key, lambda query: query.reply(b"1"))
        for key in clocks:
            while not (answers := gateway.query_all(key, b"")):
                gateway.query(Service.DESC.key(HIS), b"")
            assert answers == [b"1"]
        assert [mixed.query_all(key, b"") for key in clocks] == [[b"1"], []]
        assert [alice.query_all(key, b"") for key in clocks] == [[], []]


@pytest.mark.parametrize("name", ["alice", "camera", "tape"])
def test_no_question_is_answered_by_another_robot(stage: RouterStage, name: str) -> None:
    with (
        stage.join(name, HERS),
        stage.raw_join(name) as own,
        stage.join("gateway", HIS) as gateway,
    ):
        for selector in (*SELECTORS, *ADMIN):
            found = own.get(selector, timeout=1.0, target=zenoh.QueryTarget.ALL)
            keys = [str(reply.ok.key_expr).split("/") for reply in found if reply.ok is not None]
            # A session answers queries about itself.
            assert not [key for key in keys if key[1] not in (HERS, str(own.zid()))], selector
        assert [reply.ok for reply in own.get(Service.DESC.key(HERS)) if reply.ok is not None]
        assert gateway.query_all(Service.DESC.key(HIS), b"")


@pytest.mark.parametrize("name", ["alice", "camera", "tape"])
@pytest.mark.parametrize("selector", TOKENS)
def test_no_token_of_another_robot_is_found(stage: RouterStage, name: str, selector: str) -> None:
    with stage.join(name, HERS) as own, stage.join("gateway", HIS) as gateway:
        assert gateway.living_tokens(topics.alive_key("*"))
        found = own.living_tokens(selector)
        assert not [key for key in found if HIS in key]


def test_the_coming_and_going_of_another_robot_is_not_heard(stage: RouterStage) -> None:
    changes: dict[str, list[tuple[str, bool]]] = {"alice": [], "gateway": []}
    with stage.join("alice", HERS) as alice, stage.join("gateway", HIS) as gateway:
        for name, bus in (("alice", alice), ("gateway", gateway)):
            for pattern in ("twin/*/alive", "twin/*/instance/*"):
                bus.subscribe_liveliness(pattern, lambda *it, to=changes[name]: to.append(it))
        with Bus(stage.config(HIS)) as second:
            second.declare_token(topics.instance_key(HIS, "0123"))
            wait_for(lambda: any("0123" in key for key, _ in changes["gateway"]))
        wait_for(lambda: sum("0123" in key for key, _ in changes["gateway"]) == 2)
        assert set(alice.living_tokens("twin/*/alive")) == {topics.alive_key(HERS)}
    assert {key.split("/")[1] for key, _ in changes["alice"]} == {HERS}


def wait_for(condition: Any) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.02)


@pytest.mark.parametrize("name", ["alice", "camera", "tape"])
def test_matching_does_not_reveal_another_robot(stage: RouterStage, name: str) -> None:
    with stage.raw_join(name) as session, stage.join("bob", HIS) as bob:
        hidden = [session.declare_publisher(key) for key in (*KEYS, *PATTERNS)]
        queriers = [session.declare_querier(key) for key in SELECTORS]
        stop = session.declare_publisher(topics.STOP.key(HERS))
        wait_for(lambda: stop.matching_status.matching)
        matched(bob.publisher(topics.STOP.key(HIS), QoS.DATA))
        revealing = [
            str(each.key_expr)
            for each in (*hidden, *queriers)
            if each.matching_status.matching
            and not zenoh.KeyExpr(str(each.key_expr)).intersects(f"twin/{HERS}/**")
        ]
        assert revealing == []


@pytest.mark.parametrize("name", ["alice", "mixed", "camera", "tape"])
def test_messages_for_another_robot_do_not_arrive(telling: RouterStage, name: str) -> None:
    """Neither on its keys nor on patterns; the robot's counters and motion are the oracle.

    `mixed` may watch and stop that robot, so its stop is not sent.
    """
    robot = telling.robots[HIS].bus
    stops = [] if name == "mixed" else [topics.STOP.key(HIS)]
    keys = [
        *stops,
        topics.twist_key(HIS, name),
        topics.twist_key(HIS, "bob"),
        topics.SENSOR_POSE.key(HIS),
        topics.STATUS.key(HIS),
        topics.event_key(HIS, "mode"),
        topics.INPUTS.key(HIS),
        "twin/*/stop",
        f"twin/*/cmd/{name}/twist",
        "twin/*/sensor/pose",
        "twin/*/state/status",
    ]
    with (
        telling.raw_join(name) as own,
        telling.join("bob", HIS) as bob,
        telling.join("gateway", HIS) as gateway,
        listening(robot, f"twin/{HIS}/stop", f"twin/{HIS}/cmd/*/twist", "twin/*/sensor/*") as at,
        listening(gateway, "twin/*/state/**", "twin/*/event/*") as seen,
    ):
        seen.until(lambda sample: sample.key == topics.STATUS.key(HIS))
        for key in keys:
            own.put(key, SECRET, congestion_control=zenoh.CongestionControl.BLOCK)
        own.delete(topics.twist_key(HIS, "bob"))
        # Each robot receives only its operator's messages.
        put(bob, topics.twist_key(HIS, "bob"), b"end")
        at.until(lambda sample: sample.payload == b"end")
        seen.until(lambda sample: sample.key == topics.STATUS.key(HIS))
    heard = [s.key for s in (*at.heard, *seen.heard) if s.payload == SECRET or not s.is_put]
    assert [key for key in heard if HIS in key or "*" in key] == []


@pytest.mark.parametrize("name", ["alice", "camera", "tape"])
def test_requests_to_another_robot_have_no_effect(telling: RouterStage, name: str) -> None:
    with telling.join(name) as own, telling.join("gateway", HIS) as gateway:
        before = status_of(gateway, HIS)
        for service in SERVICES:
            assert own.query_all(service, b'{"op": "acquire", "operator": "alice"}', 0.3) == []
        own.declare_token(topics.instance_key(HIS, "0666"))
        own.declare_token(topics.alive_key(HIS))
        after = status_of(gateway, HIS)
        assert after.mode == before.mode
        assert after.lease.holder is None
        keys = gateway.living_tokens(topics.instance_key(HIS, "*"))
        assert not [key for key in keys if "0666" in key]


def status_of(bus: Bus, robot: str) -> RobotStatus:
    """Return a status sent after now."""
    with listening(bus, topics.STATUS.key(robot)) as ear:
        for _ in range(2):
            sample = ear.until(lambda _: True)
    return decode_status(sample.payload)


@pytest.mark.parametrize("name", ["guest", "mixed"])
def test_a_robot_may_be_watched_and_stopped_but_not_driven(stage: RouterStage, name: str) -> None:
    with stage.join(name, HIS) as own, listening(own, "twin/*/state/**") as seen:
        seen.until(lambda sample: sample.key == topics.ODOM.key(HIS))
        assert own.query_all(Service.DESC.key(HIS), b"")
        lease = b'{"op": "acquire", "operator": "%s"}' % name.encode()
        assert own.query_all(Service.LEASE.key(HIS), lease, 0.5) == []
        for key in (topics.twist_key(HIS, name), topics.SENSOR_POSE.key(HIS)):
            assert not own.publisher(key, QoS.DATA).has_subscribers
        put(own, topics.STOP.key(HIS), b"{}")
        seen.until(
            lambda s: s.key == topics.STATUS.key(HIS) and decode_status(s.payload).mode == "stopped"
        )


def test_a_robot_cannot_act_as_another(telling: RouterStage) -> None:
    """With its certificate, it cannot read messages to another robot either."""
    forged = [topics.STATUS.key(HIS), topics.ODOM.key(HIS), topics.event_key(HIS, "mode")]
    asked: list[object] = []
    hers = telling.robots[HERS].bus
    with (
        telling.raw_join(HERS) as own,
        telling.join("gateway", HIS) as gateway,
        telling.join("bob", HIS) as bob,
        listening(hers, f"twin/{HIS}/**", "twin/*/cmd/**", "twin/**", "**") as overheard,
        listening(telling.robots[HIS].bus, f"twin/{HIS}/cmd/*/twist") as at_his,
        listening(gateway, "twin/*/state/**", "twin/*/event/*") as seen,
        own.declare_queryable(Service.DESC.key(HIS), asked.append),
    ):
        for key in forged:
            own.put(key, SECRET, congestion_control=zenoh.CongestionControl.BLOCK)
        put(bob, topics.twist_key(HIS, "bob"), b"end")
        at_his.until(lambda sample: sample.payload == b"end")
        seen.until(lambda sample: sample.key == topics.STATUS.key(HIS))
        seen.until(lambda sample: sample.key == topics.STATUS.key(HERS))
        assert len(gateway.query_all(Service.DESC.key(HIS), b"")) == 1
    assert asked == []
    assert SECRET not in {sample.payload for sample in seen.heard}
    assert not [each for each in overheard.heard if not each.key.startswith(f"twin/{HERS}/")]


def test_a_certificate_that_the_rules_do_not_name_reaches_no_robot(
    stage: RouterStage, tmp_path: Path
) -> None:
    """From the same authority, made after the router was started."""
    shutil.copytree(stage.folder.path, tmp_path / "keys")
    carol = security.client("carol", Role.OPERATOR)
    folder = make_router_keys(
        tmp_path / "keys", identities=[carol], rights={"carol": rights(ALL)}, listen=None
    )
    later = dataclasses.replace(stage.config("alice"), files=files_of(folder, "carol"))
    with Bus(later) as bus, listening(bus, *PATTERNS) as seen:
        assert bus.wait_for_peer(PATIENCE_S)
        assert bus.living_tokens("twin/*/alive") == []
        for robot in (HERS, HIS):
            assert bus.query_all(Service.DESC.key(robot), b"", 0.5) == []
    assert seen.heard == []


def files_of(folder: KeyFolder, name: str) -> dict[str, Path]:
    """Return the session settings that name files, for another client."""
    return dict(from_file(str(folder.settings_file(name))).files)
