"""Normal use of a robot behind TLS and access rules, over real sessions."""

from __future__ import annotations

import contextlib
import queue
from collections.abc import Generator

import msgspec
import pytest

from tests.support.robot_node import raw_session
from tests.support.secured_robot import (
    DESCRIPTION,
    ID,
    Listener,
    SecuredRobot,
    ask,
    hold,
    listening,
    make_keys,
    put,
    set_free,
)
from tests.support.withheld import PATIENCE_S
from tsd_twin.bus import Bus
from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import BASE, decode_odometry
from tsd_twin.messages.services import HolderRequest, StopRequest
from tsd_twin.messages.topics import Sample, Service

pytestmark = pytest.mark.system

STATUS = topics.STATUS.key(ID)
STOP = topics.STOP.key(ID)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Generator[SecuredRobot]:
    guarded = SecuredRobot(make_keys(tmp_path_factory.mktemp("network") / "keys"))
    yield guarded
    guarded.close()


@pytest.fixture
def alice(robot: SecuredRobot) -> Generator[Bus]:
    """An operator, who leaves the robot free at the end."""
    with robot.join("alice") as bus:
        yield bus
        set_free(bus)


@pytest.fixture
def guest(robot: SecuredRobot) -> Generator[Bus]:
    """A viewer."""
    with robot.join("guest") as bus:
        yield bus


def test_a_page_of_an_operator_drives(robot: SecuredRobot, alice: Bus) -> None:
    link = RobotMonitor(alice, ID)
    driver = hold(link, "alice-0123abcd")
    assert ask(link, Service.ARM, HolderRequest(driver.lease_hex)).ok
    robot.status(lambda status: status.mode == "ready")

    def moves(sample: Sample) -> bool:
        if sample.key != STATUS:
            return bool(decode_odometry(sample.payload).twist[0] > 0.15)
        link.poll(0.0)
        seen = link.snapshot.status_seq
        link.send(driver.command((0.2, 0.0, 0.0), BASE, link.now_s(), seen))
        return False

    with listening(alice, STATUS, topics.ODOM.key(ID)) as ear:
        ear.until(moves)
    assert ask(link, Service.DISARM, HolderRequest(driver.lease_hex)).ok
    robot.status(lambda status: status.mode == "disarmed")
    link.close()


def test_a_viewer_sees_the_robot_with_its_description_and_its_state(guest: Bus) -> None:
    assert set(guest.living_tokens(topics.alive_key("*"))) == {topics.alive_key(ID)}
    link = RobotMonitor(guest, ID)
    assert link.description.urdf == DESCRIPTION.urdf
    link.close()
    for topic in (topics.JOINTS, topics.SETPOINT, topics.ODOM, topics.TRUTH, topics.STATUS):
        for key in (topic.key("*"), topic.key(ID), "twin/*/state/**"):
            with listening(guest, key) as ear:
                ear.until(lambda sample, topic=topic: sample.key == topic.key(ID))


def test_a_tool_that_asks_who_lives_once_is_told(robot: SecuredRobot) -> None:
    with raw_session(robot.config("guest", mode="client")) as tool:
        answers = list(tool.liveliness().get(topics.alive_key("*")))
    assert {str(answer.ok.key_expr) for answer in answers} == {topics.alive_key(ID)}


def test_a_viewer_who_comes_late_gets_the_events_that_were_before(
    robot: SecuredRobot, alice: Bus
) -> None:
    link = RobotMonitor(alice, ID)
    with listening(robot.bus, topics.EVENT.key(ID)) as said:
        hold(link, "alice")
        assert not ask(link, Service.RESET, HolderRequest("0" * 32)).ok
        said.until(lambda sample: sample.key == topics.event_key(ID, "refusal"))
    wanted = {sample.payload for sample in said.heard}
    assert len(wanted) == 2
    with robot.join("guest") as late:
        ear = Listener()
        late.subscribe_events(topics.EVENT.key("*"), ear)
        ear.until(lambda _: wanted <= {sample.payload for sample in ear.heard})
        hold(link, "alice-again")
        ear.until(lambda sample: b"alice-again" in sample.payload)
        events = [sample.payload for sample in ear.heard]
        assert len(events) == len(set(events)), "an event came twice"
    link.close()


@pytest.mark.parametrize("name", ["alice", "guest"])
def test_anybody_may_stop_by_putting_and_by_asking(
    robot: SecuredRobot, alice: Bus, guest: Bus, name: str
) -> None:
    bus = {"alice": alice, "guest": guest}[name]
    put(bus, STOP, msgspec.json.encode(StopRequest(name, "put")))
    assert robot.status(lambda status: status.mode == "stopped").stop_reason == "put"
    link = RobotMonitor(alice, ID)
    assert ask(link, Service.RESET, HolderRequest(hold(link, "alice").lease_hex)).ok
    link.close()
    reply = msgspec.json.decode(
        bus.query(STOP, msgspec.json.encode(StopRequest(name, "asked")), PATIENCE_S)
    )
    assert reply["ok"]
    assert robot.status(lambda status: status.mode == "stopped").stop_reason == "asked"


def test_after_a_restart_viewers_see_the_robot_again_and_what_it_said_meanwhile(
    robot: SecuredRobot,
) -> None:
    ear, lives = Listener(), queue.SimpleQueue[bool]()
    with contextlib.ExitStack() as stack:
        first = stack.enter_context(contextlib.closing(SecuredRobot(robot.folder)))
        guest = stack.enter_context(Bus(first.config("guest")))
        guest.subscribe_events(topics.EVENT.key("*"), ear)
        guest.subscribe_liveliness(topics.alive_key("*"), lambda _key, alive: lives.put(alive))
        assert lives.get(timeout=PATIENCE_S)
        first.close()
        assert not lives.get(timeout=PATIENCE_S)
        again = SecuredRobot(robot.folder, listen=first.endpoint)
        stack.enter_context(contextlib.closing(again))
        # The refusal becomes an event before the viewer has reconnected.
        again.bus.query(Service.RESET.key(ID), b"{}")
        assert lives.get(timeout=PATIENCE_S)
        ear.until(lambda sample: sample.key == topics.event_key(ID, "refusal"))
