"""Signed commands in virtual time: a hostile router cannot move a robot."""

from __future__ import annotations

import json
import random
from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tsd_twin import robots
from tsd_twin.client.lease_signing import LeaseSigning
from tsd_twin.client.protocol import ControlProtocol
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import BASE
from tsd_twin.messages.codes import Code, Reason
from tsd_twin.messages.commands import decode_command
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.services import HolderRequest, LeaseReply, LeaseRequest, decode_json
from tsd_twin.messages.signatures import split_signature
from tsd_twin.messages.topics import Sample, Service
from tsd_twin.safety.lease import LeaseManager
from tsd_twin.security.command_authority import REQUEST_AGE_S, CommandAuthority
from tsd_twin.security.operator_list import ListedOperator, OperatorList, is_same_operator
from tsd_twin.security.signing_keys import new_signing_key, public_bytes

ROBOT = robots.load_robot("tsd")
ALICE, EVE = new_signing_key(), new_signing_key()
LISTED = OperatorList(1, {"alice": ListedOperator((public_bytes(ALICE).hex(),))})
REVOKED = OperatorList(2, LISTED.operators, frozenset({public_bytes(ALICE).hex()}))


@dataclass
class Robot:
    """Signature check and leases of a robot; collects the accepted commands."""

    id: str
    ids: random.Random
    passed: list[Sample] = field(default_factory=list)
    requests: list[tuple[Service, bytes]] = field(default_factory=list)
    now_s: float = 0.0

    def __post_init__(self) -> None:
        self.authority = CommandAuthority(self.id, LISTED)
        self.leases = LeaseManager(ROBOT, lambda: self.ids.randbytes(16))
        self.status = 0
        self.send_status()

    def send_status(self) -> int:
        self.status += 1
        self.authority.record_status(self.status, self.now_s)
        return self.status

    def command(self, sample: Sample) -> Reason | None:
        checked = self.authority.check_command(sample)
        if isinstance(checked, Reason):
            return checked
        decode_command(checked)
        self.passed.append(checked)
        return None

    def ask(self, service: Service, payload: bytes) -> Reason | LeaseReply | None:
        checked = self.authority.check_request(service, payload, self.now_s)
        if isinstance(checked, Reason):
            return checked
        if service is Service.LEASE:
            try:
                request = decode_json(checked, LeaseRequest, "a request")
            except MessageError:
                return None  # The controller refuses it, too.
        self.requests.append((service, checked))
        if service is not Service.LEASE:
            return None
        reply = self.authority.complete(self.leases.answer(request, self.now_s))
        assert isinstance(reply, LeaseReply)
        return reply


class Operator:
    """Client core with a key."""

    def __init__(self, robot: Robot, name: str = "alice", key: object = ALICE) -> None:
        self.robot = robot
        signing = None if key is None else LeaseSigning(key, robot.id)  # type: ignore[arg-type]
        self.protocol = ControlProtocol(robot.id, ROBOT, name, signing=signing)
        self.sent: list[Sample] = []
        self.asked: list[tuple[Service, bytes]] = []

    def wish(self, op: str = "acquire") -> bytes:
        request = LeaseRequest(op=op, operator=self.protocol.operator, take_over=True)  # type: ignore[arg-type]
        return self.protocol.encode(Service.LEASE, request)

    def acquire(self) -> Reason | None:
        payload = self.wish()
        self.asked.append((Service.LEASE, payload))
        reply = self.robot.ask(Service.LEASE, payload)
        if isinstance(reply, LeaseReply):
            self.protocol.grant(reply, self.robot.now_s)
            return None
        return reply

    def command(self, vx_mps: float) -> Sample:
        self.protocol.status_seq = self.robot.status
        made = self.protocol.command((vx_mps, 0.0, 0.0), BASE, self.robot.now_s)
        key = topics.twist_key(self.robot.id, made.operator)
        self.sent.append(Sample(key, made.payload, made.attachment))
        return self.sent[-1]

    def request(self, service: Service) -> bytes:
        self.protocol.status_seq = self.robot.status
        payload = self.protocol.encode(service, HolderRequest(self.protocol.lease_hex))
        self.asked.append((service, payload))
        return payload


def code_of(outcome: object) -> str | None:
    return outcome.code if isinstance(outcome, Reason) else None


@pytest.fixture
def robot() -> Robot:
    return Robot("lab1", random.Random(0))  # noqa: S311


def test_a_listed_operator_drives(robot: Robot) -> None:
    alice = Operator(robot)
    assert alice.acquire() is None
    assert robot.command(alice.command(0.3)) is None
    for service in (Service.ARM, Service.RESET, Service.DISARM, Service.SET_POSE, Service.SPEED):
        assert robot.ask(service, alice.request(service)) is None
    renewal = alice.protocol.renewal(robot.now_s + 1.0)
    assert renewal is not None
    renewed = robot.ask(Service.LEASE, renewal)
    assert isinstance(renewed, LeaseReply)
    assert renewed.granted


def test_without_a_key_or_with_that_of_another_nothing_counts(robot: Robot) -> None:
    assert code_of(Operator(robot, key=None).acquire()) == Code.SIGNATURE_MISSING
    assert code_of(Operator(robot, key=EVE).acquire()) == Code.KEY_REFUSED
    assert code_of(Operator(robot, "bob", ALICE).acquire()) == Code.KEY_REFUSED
    alice = Operator(robot)
    assert alice.acquire() is None
    command = alice.command(0.3)
    bare = Sample(command.key, command.payload, command.attachment[:32])
    assert code_of(robot.command(bare)) == Code.SIGNATURE_MISSING
    for service in (Service.ARM, Service.RESET, Service.DISARM, Service.SET_POSE, Service.SPEED):
        body, _ = split_signature(alice.request(service))
        assert code_of(robot.ask(service, body)) == Code.SIGNATURE_MISSING


def test_stop_and_peek_need_no_signature(robot: Robot) -> None:
    assert robot.ask(Service.STOP, b"") is None
    assert robot.ask(Service.STOP, b'{"operator": "guest"}') is None
    peek = json.dumps({"op": "peek", "operator": "guest"}).encode()
    assert isinstance(robot.ask(Service.LEASE, peek), LeaseReply)


def test_a_repeated_request_counts_once(robot: Robot) -> None:
    alice = Operator(robot)
    wish = alice.wish()
    assert isinstance(robot.ask(Service.LEASE, wish), LeaseReply)
    assert code_of(robot.ask(Service.LEASE, wish)) == Code.SIGNATURE_REPEATED
    assert alice.acquire() is None
    arm = alice.request(Service.ARM)
    assert robot.ask(Service.ARM, arm) is None
    assert code_of(robot.ask(Service.ARM, arm)) == Code.SIGNATURE_REPEATED


def test_requests_may_overtake_each_other(robot: Robot) -> None:
    alice = Operator(robot)
    alice.acquire()
    first, second = alice.request(Service.ARM), alice.request(Service.RESET)
    assert robot.ask(Service.RESET, second) is None
    assert robot.ask(Service.ARM, first) is None


def test_a_request_that_was_held_back_does_not_count(robot: Robot) -> None:
    alice = Operator(robot)
    alice.acquire()
    arm = alice.request(Service.ARM)
    robot.now_s += REQUEST_AGE_S + 0.01
    robot.send_status()
    assert code_of(robot.ask(Service.ARM, arm)) == Code.SIGNATURE_LATE
    assert robot.ask(Service.ARM, alice.request(Service.ARM)) is None


def test_a_message_for_another_robot_service_or_lease_does_not_count(robot: Robot) -> None:
    other = Robot("lab2", random.Random(0))  # noqa: S311
    alice, there = Operator(robot), Operator(other)
    assert alice.acquire() is None
    assert there.acquire() is None
    assert alice.protocol.lease_hex == there.protocol.lease_hex  # The router may arrange that.
    command = alice.command(0.3)
    moved = Sample(topics.twist_key("lab2", "alice"), command.payload, command.attachment)
    assert code_of(other.command(moved)) == Code.SIGNATURE_WRONG
    assert code_of(other.ask(Service.LEASE, alice.wish())) == Code.SIGNATURE_WRONG
    assert code_of(other.ask(Service.ARM, alice.request(Service.ARM))) == Code.SIGNATURE_WRONG
    assert code_of(robot.ask(Service.ARM, alice.request(Service.RESET))) == Code.SIGNATURE_WRONG
    assert alice.acquire() is None
    assert code_of(robot.command(command)) == Code.SIGNATURE_WRONG


def test_a_revoked_key_moves_the_robot_no_further(robot: Robot) -> None:
    alice = Operator(robot)
    alice.acquire()
    assert robot.command(alice.command(0.3)) is None
    robot.authority.set_operators(REVOKED)
    assert code_of(robot.command(alice.command(0.3))) == Code.KEY_REFUSED
    assert code_of(robot.ask(Service.ARM, alice.request(Service.ARM))) == Code.KEY_REFUSED
    assert robot.ask(Service.DISARM, alice.request(Service.DISARM)) is None  # It can only stop.
    assert code_of(alice.acquire()) == Code.KEY_REFUSED


NAMES = st.from_regex(r"[a-z0-9_-]{1,23}", fullmatch=True)


@given(NAMES, st.from_regex(r"[a-z0-9_-]{1,32}", fullmatch=True))
def test_a_key_is_for_its_name_and_its_pages_only(name: str, operator: str) -> None:
    rest = operator.removeprefix(name) if operator.startswith(name) else None
    page = rest is not None and len(rest) == 9 and rest[0] == "-"
    hexes = page and rest is not None and all(c in "0123456789abcdef" for c in rest[1:])
    assert is_same_operator(name, operator) == (operator == name or hexes)


@given(NAMES, st.from_regex(r"[a-z0-9_-]{0,12}", fullmatch=True))
def test_a_name_that_goes_on_is_another_operator(name: str, more: str) -> None:
    pages = len(more) == 8 and all(c in "0123456789abcdef" for c in more)
    assert is_same_operator(name, f"{name}-{more}") == pages
    assert is_same_operator(name, f"{name}-12ab34cd")
    assert is_same_operator(name, f"{name}-{more}", for_users=True)


def _attack(message: bytes, dice: random.Random) -> bytes:
    """Change, truncate, extend or keep a message."""
    match dice.randrange(4):
        case 0 if message:
            at = dice.randrange(len(message))
            return message[:at] + bytes([message[at] ^ 1 << dice.randrange(8)]) + message[at + 1 :]
        case 1:
            return message[: dice.randrange(len(message) + 1)]
        case 2:
            return message + dice.randbytes(dice.randrange(1, 20))
        case _:
            return message


def _forge(robot: Robot, person: Operator, dice: random.Random) -> None:
    """Send a command with the right lease, signed by a stranger's key."""
    forger = Operator(robot, key=EVE)
    assert forger.acquire() is not None
    lease = person.protocol.lease_hex
    forger.protocol.grant(LeaseReply(True, lease, max_age_s=1.0, key="ab" * 32), robot.now_s)
    assert robot.command(forger.command(dice.uniform(-1.0, 1.0))) is not None


def _replay_command(robot: Robot, sent: list[Sample], dice: random.Random) -> None:
    """Replay any operator's command to a robot: later, changed, or under another name."""
    if sent:
        took, name = dice.choice(sent), dice.choice(("alice", "alice-b", "eve"))
        key = topics.twist_key(robot.id, name)
        robot.command(Sample(key, _attack(took.payload, dice), _attack(took.attachment, dice)))


def _operate(robot: Robot, person: Operator, dice: random.Random) -> None:
    """Perform an action that the operator may do."""
    match dice.randrange(3):
        case 0:
            person.acquire()
        case 1:
            robot.command(person.command(dice.uniform(-1.0, 1.0)))
        case _:
            service = dice.choice((Service.ARM, Service.RESET, Service.DISARM))
            robot.ask(service, person.request(service))


@settings(max_examples=60)
@given(st.randoms(use_true_random=False))
def test_whatever_a_router_does_only_what_was_sent_to_this_robot_passes(
    dice: random.Random,
) -> None:
    stages = [Robot("lab1", random.Random(1)), Robot("lab2", random.Random(1))]  # noqa: S311
    people = [Operator(robot) for robot in stages]
    for person in people:
        person.acquire()
    for _ in range(60):
        robot, person = dice.choice(list(zip(stages, people, strict=True)))
        robot.now_s += dice.choice((0.0, 0.02, 0.3))
        robot.send_status()
        match dice.randrange(6):
            case 0 | 1:
                _operate(robot, person, dice)
            case 2:
                _forge(robot, person, dice)
            case 3 | 4:
                _replay_command(robot, [x for each in people for x in each.sent], dice)
            case _:
                service, payload = dice.choice([x for each in people for x in each.asked])
                other = dice.choice((service, Service.ARM, Service.LEASE))
                robot.ask(other, _attack(payload, dice))
    for robot, person in zip(stages, people, strict=True):
        made = [(sample.key, sample.payload, sample.attachment[:32]) for sample in person.sent]
        assert all((s.key, s.payload, s.attachment) in made for s in robot.passed)
        asked = [(service, split_signature(payload)[0]) for service, payload in person.asked]
        numbered = [each for each in robot.requests if each[0] is not Service.LEASE]
        assert len(numbered) <= len([each for each in asked if each[0] is not Service.LEASE])
        assert all(each in asked for each in robot.requests)
