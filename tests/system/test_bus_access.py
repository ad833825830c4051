"""Forbidden actions of authenticated peers on a robot, tried with real sessions.

No test waits for a fixed time: a message is shown not to arrive by a later one on the same path
that does.
"""

from __future__ import annotations

from collections.abc import Generator

import msgspec
import pytest

from tests.support.robot_node import poll_until
from tests.support.secured_robot import (
    DESCRIPTION,
    ID,
    SecuredRobot,
    ask_lease,
    hold,
    listening,
    make_keys,
    put,
    set_free,
)
from tests.support.withheld import PATIENCE_S
from tsd_twin.bus import Bus, as_client, clients_of
from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.errors import NoAnswerError
from tsd_twin.messages import topics
from tsd_twin.messages.pictures import ALIVE_KEYS, LARGEST_PICTURE, CameraName
from tsd_twin.messages.services import LeaseRequest
from tsd_twin.messages.status import decode_status
from tsd_twin.messages.topics import QoS, Sample, Service, Topic
from tsd_twin.recording import ALLOWED
from tsd_twin.security.key_folder import KeyFolder

pytestmark = pytest.mark.system

COMMANDS = topics.TWIST.key(ID)
STATUS = topics.STATUS.key(ID)
STOP = topics.STOP.key(ID)
POSES = topics.SENSOR_POSE.key(ID)
ALICES, PAGES, BOBS, GUESTS = (
    topics.twist_key(ID, name) for name in ("alice", "alice-0123abcd", "bob", "guest")
)
CAMERAS = CameraName("front", ID), CameraName("ceiling")
FORGED, RUBBISH = b"forged", b"rubbish"


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> KeyFolder:
    return make_keys(tmp_path_factory.mktemp("access") / "keys")


@pytest.fixture(scope="module", params=[False, True], ids=["as made", "told who listens"])
def robot(request: pytest.FixtureRequest, keys: KeyFolder) -> Generator[SecuredRobot]:
    guarded = SecuredRobot(keys, told=request.param)
    yield guarded
    survived = guarded.is_running
    guarded.close()
    assert survived


@pytest.fixture
def alice(robot: SecuredRobot) -> Generator[Bus]:
    """An operator, who leaves the robot free at the end."""
    with robot.join("alice") as bus:
        yield bus
        set_free(bus)


@pytest.fixture
def bob(robot: SecuredRobot) -> Generator[Bus]:
    """Another operator."""
    with robot.join("bob") as bus:
        yield bus


@pytest.fixture
def guest(robot: SecuredRobot) -> Generator[Bus]:
    """A viewer."""
    with robot.join("guest") as bus:
        yield bus


@pytest.fixture
def camera(robot: SecuredRobot) -> Generator[Bus]:
    """A sensor."""
    with robot.join("camera") as bus:
        yield bus


def misshapen(sample: Sample) -> int:
    """Return the robot's count of malformed commands, or -1 if `sample` is not a status."""
    if sample.key != STATUS or sample.payload == FORGED:
        return -1
    return decode_status(sample.payload).command.dropped.shape


@pytest.mark.parametrize("key", [GUESTS, ALICES, COMMANDS, "twin/*/cmd/**"])
def test_a_command_of_a_viewer_does_not_reach_the_robot(
    robot: SecuredRobot, alice: Bus, guest: Bus, key: str
) -> None:
    hold(link := RobotMonitor(alice, ID), "alice")
    before = robot.status().command
    with listening(robot.bus, COMMANDS, STOP) as ear:
        robot.force(guest, key, FORGED)
        put(guest, STOP, RUBBISH)
        ear.until(lambda sample: sample.key == STOP)
    assert [sample.key for sample in ear.heard] == [STOP]
    after = robot.status(lambda status: status.mode == "stopped").command
    assert (after.accepted, after.dropped) == (before.accepted, before.dropped)
    link.close()


def test_a_viewer_gets_no_control(alice: Bus, guest: Bus) -> None:
    link = RobotMonitor(alice, ID)
    driver = hold(link, "alice")
    request = LeaseRequest(op="acquire", operator="guest", take_over=True)
    for service in Service:
        if service.startswith("srv/"):
            with pytest.raises(NoAnswerError):
                guest.query(service.key(ID), msgspec.json.encode(request))
    renew = LeaseRequest(op="renew", operator="alice", lease=driver.lease_hex)
    assert ask_lease(link, renew).granted
    link.close()


@pytest.mark.usefixtures("alice")
def test_only_a_sensor_says_where_the_robot_is(
    robot: SecuredRobot, bob: Bus, guest: Bus, camera: Bus
) -> None:
    with listening(robot.bus, POSES, BOBS, STOP) as ear:
        robot.force(bob, POSES, FORGED)
        put(bob, BOBS, RUBBISH)
        robot.force(guest, POSES, FORGED)
        put(guest, STOP, RUBBISH)
        put(camera, POSES, RUBBISH)
        for key in (BOBS, STOP, POSES):
            if key not in {sample.key for sample in ear.heard}:
                ear.until(lambda sample, key=key: sample.key == key)
    assert FORGED not in {sample.payload for sample in ear.heard}
    heard = robot.status(lambda status: status.pose_sensor is not None).pose_sensor
    assert heard is not None
    assert heard.dropped.shape > 0


def test_an_operator_who_calibrates_hears_where_a_sensor_sees_the_robot(
    robot: SecuredRobot, camera: Bus, guest: Bus
) -> None:
    """For any way in which the sensor joined; viewers cannot receive it."""
    with (
        Bus(as_client(robot.config("alice"), PATIENCE_S)) as lab,
        listening(lab, POSES) as ear,
        listening(guest, POSES, STATUS) as other,
    ):
        while not ear.heard:  # A new subscriber may miss some.
            put(camera, POSES, RUBBISH)
            other.until(lambda sample: sample.key == STATUS)
    assert {sample.payload for sample in ear.heard} == {RUBBISH}
    assert {sample.key for sample in other.heard} == {STATUS}


def test_only_a_sensor_shows_pictures_and_the_largest_pass_the_robot(
    robot: SecuredRobot, bob: Bus, camera: Bus
) -> None:
    before = robot.status().command.dropped.shape
    tokens = [camera.declare_token(name.alive_key) for name in CAMERAS]
    with (
        Bus(as_client(robot.config("guest"), PATIENCE_S)) as viewer,
        listening(viewer, "twin/*/camera/**", "floor/**", STATUS) as seen,
    ):
        seen.until(lambda sample: sample.key == STATUS)
        for name in CAMERAS:
            robot.force(bob, name.key, FORGED)
        put(bob, BOBS, RUBBISH)
        seen.until(lambda sample: misshapen(sample) > before)
        for name in CAMERAS:
            while name.key not in {sample.key for sample in seen.heard}:
                put(camera, name.key, bytes(LARGEST_PICTURE))
                seen.until(lambda sample: sample.key == STATUS)
        alive = {key for pattern in ALIVE_KEYS for key in viewer.living_tokens(pattern)}
    pictures = {sample.payload for sample in seen.heard if sample.key != STATUS}
    assert pictures == {bytes(LARGEST_PICTURE)}
    assert alive == {name.alive_key for name in CAMERAS}
    for token in tokens:
        token.close()


def test_only_a_sensor_answers_for_the_clock_of_a_camera(
    robot: SecuredRobot, bob: Bus, camera: Bus
) -> None:
    for name in CAMERAS:
        bob.serve(name.clock_key, lambda query: query.reply(FORGED))
    bob.query(Service.DESC.key(ID), b"")  # The robot has handled what came before.
    for name in CAMERAS:
        camera.serve(name.clock_key, lambda query: query.reply(RUBBISH))
    with Bus(as_client(robot.config("guest"), PATIENCE_S)) as viewer:
        for name in CAMERAS:
            while not (answers := viewer.query_all(name.clock_key, b"")):
                robot.status()
            assert answers == [RUBBISH]


@pytest.mark.parametrize("key", [ALICES, COMMANDS, f"twin/{ID}/cmd/camera/twist", STATUS])
def test_a_sensor_says_nothing_else_and_gets_no_control(
    robot: SecuredRobot, alice: Bus, camera: Bus, key: str
) -> None:
    with listening(robot.bus, COMMANDS, POSES) as ear, listening(alice, STATUS) as seen:
        robot.force(camera, key, FORGED)
        put(camera, POSES, RUBBISH)
        ear.until(lambda sample: sample.key == POSES)
        seen.until(lambda sample: sample.key == STATUS)
    assert FORGED not in {sample.payload for sample in ear.heard + seen.heard}
    request = LeaseRequest(op="acquire", operator="camera", take_over=True)
    with pytest.raises(NoAnswerError):
        camera.query(Service.LEASE.key(ID), msgspec.json.encode(request))


@pytest.mark.parametrize("key", [ALICES, PAGES, COMMANDS])
def test_an_operator_cannot_send_on_the_key_of_another_nor_on_those_of_all(
    robot: SecuredRobot, bob: Bus, key: str
) -> None:
    with listening(robot.bus, COMMANDS) as ear:
        put(bob, key, FORGED)
        put(bob, BOBS, RUBBISH)
        ear.until(lambda sample: sample.key == BOBS)
    assert [sample.payload for sample in ear.heard] == [RUBBISH]


@pytest.mark.parametrize("key", ["twin/*/cmd/bob/twist", f"twin/{ID}/cmd/bob-$*/twist"])
def test_what_an_operator_sends_on_a_pattern_of_the_own_keys_is_dropped_and_counted(
    robot: SecuredRobot, bob: Bus, key: str
) -> None:
    before = robot.status().command
    put(bob, key, FORGED)
    put(bob, BOBS, RUBBISH)
    after = robot.status(lambda status: status.command.dropped.shape > before.dropped.shape).command
    assert after.dropped.key == before.dropped.key + 1
    assert after.accepted == before.accepted


def test_a_deletion_does_not_reach_the_robot(robot: SecuredRobot) -> None:
    with listening(robot.bus, COMMANDS) as ear, robot.raw_join("bob") as bob:
        sender = bob.declare_publisher(BOBS)
        poll_until(lambda: sender.matching_status.matching)
        sender.put(RUBBISH)
        sender.delete()
        sender.put(RUBBISH)
        ear.until(lambda _: len(ear.heard) == 2)
    assert all(sample.is_put for sample in ear.heard)


def test_a_command_that_is_too_long_does_not_reach_the_robot(robot: SecuredRobot, bob: Bus) -> None:
    with listening(robot.bus, COMMANDS) as ear:
        for length in (4097, 1_000_000, 4096):
            put(bob, BOBS, bytes(length))
        ear.until(lambda _: True)
    assert len(ear.heard[0].payload) == 4096


@pytest.mark.parametrize("topic", [topics.ODOM, topics.STATUS, topics.EVENT])
def test_nobody_hears_a_state_that_an_operator_forges(
    robot: SecuredRobot, bob: Bus, guest: Bus, topic: Topic
) -> None:
    key = topic.key(ID).replace("*", "mode")
    before = robot.status().command.dropped.shape
    with listening(guest, key, STATUS) as seen, listening(robot.bus, key) as at_home:
        seen.until(lambda sample: sample.key == STATUS)
        robot.force(bob, key, FORGED)
        put(bob, BOBS, RUBBISH)
        # The robot reports the count on the path that the forged state would have taken.
        seen.until(lambda sample: misshapen(sample) > before)
    assert FORGED not in {sample.payload for sample in seen.heard + at_home.heard}


@pytest.mark.parametrize("topic", [topics.ODOM, topics.STATUS, topics.EVENT])
def test_nobody_hears_a_state_that_a_viewer_forges(
    robot: SecuredRobot, alice: Bus, guest: Bus, topic: Topic
) -> None:
    key = topic.key(ID).replace("*", "mode")
    with listening(alice, key, STATUS) as seen:
        seen.until(lambda sample: sample.key == STATUS)
        robot.force(guest, key, FORGED)
        put(guest, STOP, RUBBISH)
        seen.until(lambda sample: sample.key == STATUS and b'"stopped"' in sample.payload)
    assert FORGED not in {sample.payload for sample in seen.heard}


def test_nobody_can_pose_as_a_robot(robot: SecuredRobot, bob: Bus, guest: Bus) -> None:
    before = robot.status().command.dropped.shape
    bob.declare_token(topics.alive_key("false"))
    posing = [bob.queryable(Service.DESC.key(name), patterns=True) for name in ("false", ID)]
    put(bob, BOBS, RUBBISH)
    robot.status(lambda status: status.command.dropped.shape > before)
    assert set(guest.living_tokens(topics.alive_key("*"))) == {topics.alive_key(ID)}
    assert DESCRIPTION.urdf.encode() in guest.query(Service.DESC.key(ID), b"")
    with pytest.raises(NoAnswerError):
        guest.query(Service.DESC.key("false"), b"")
    assert [each.take_requests() for each in posing] == [[], []]


@pytest.mark.parametrize("key", [COMMANDS, f"twin/{ID}/**", "**"])
def test_nobody_overhears_the_commands_of_another(
    robot: SecuredRobot, bob: Bus, guest: Bus, key: str
) -> None:
    with listening(guest, key) as ear, listening(guest, STATUS) as seen:
        seen.until(lambda _: True)
        before = robot.status().command.dropped.shape
        put(bob, BOBS, RUBBISH)
        seen.until(lambda sample: misshapen(sample) > before)
        assert RUBBISH not in {sample.payload for sample in ear.heard}


def test_nobody_reads_the_books_of_the_robots_own_session(robot: SecuredRobot, alice: Bus) -> None:
    books = f"@/{robot.bus.id}/router"
    assert robot.bus.query_all(books, b"", 2.0) != []
    assert alice.query_all(books, b"", 2.0) == []


def test_a_recorder_reads_all_that_is_sent_and_others_no_lease_ids(
    robot: SecuredRobot, alice: Bus, guest: Bus
) -> None:
    """The keys that `tsd-record` subscribes to with a certificate; no rule denies one."""
    (config,) = clients_of(robot.config("tape"), PATIENCE_S)
    inputs = topics.INPUTS.key(ID)
    with Bus(config) as tape, listening(tape, *ALLOWED) as recorded:
        with listening(guest, inputs, "twin/*/log/**", "twin/**", STATUS) as seen:
            wanted = {inputs, STATUS, ALICES}
            recorded.until(lambda sample: sample.key == inputs)
            put(alice, ALICES, RUBBISH)
            recorded.until(lambda sample: sample.key == ALICES)
            robot.bus.publisher(topics.event_key(ID, "mode"), QoS.DATA).put(b"{}")
            recorded.until(lambda sample: sample.key.endswith("/event/mode"))
            recorded.until(lambda sample: sample.key == STATUS)
            seen.until(lambda sample: sample.key == STATUS)
            assert wanted <= {sample.key for sample in recorded.heard}
            assert inputs not in {sample.key for sample in seen.heard}
        with pytest.raises(NoAnswerError):
            tape.query(Service.LEASE.key(ID), b'{"op": "peek", "operator": "tape"}', 1.0)
