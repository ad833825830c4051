"""Refusals in the status agree with service replies at the same time."""

from __future__ import annotations

import copy
import random
from collections import defaultdict
from typing import Any

import msgspec
import pytest

from tests.support.controller_harness import ControllerHarness, HarnessOperator
from tsd_twin import robots
from tsd_twin.lie import SE2
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.modes import LATCHED, Mode
from tsd_twin.messages.services import LeaseReply
from tsd_twin.messages.status import Refusals
from tsd_twin.messages.topics import Service

every_robot = pytest.mark.parametrize("name", robots.robot_names())
OPERATORS = ("alice", "bob")
STRANGER = "carol"
UNKNOWN_LEASE = "ab" * 16
HOLDER_SERVICES = {
    "arm": Service.ARM,
    "disarm": Service.DISARM,
    "reset": Service.RESET,
    "set_pose": Service.SET_POSE,
    "speed": Service.SPEED,
}


class RandomOperators:
    """A robot with operators who send random requests."""

    def __init__(self, name: str, seed: int) -> None:
        self.rig = ControllerHarness(robot=robots.load_robot(name))
        self.random = random.Random(seed)  # noqa: S311  A test, not a secret.
        self.leases = dict.fromkeys(OPERATORS, UNKNOWN_LEASE)
        self.pilots: dict[str, HarnessOperator] = {}
        self.done: list[str] = []

    def act(self) -> None:
        """Take one random action that changes the refusals."""
        rule = self.random.choices(
            (
                self.requests_lease,
                self.hands_over,
                self.requests_as_holder,
                self.gets_ready,
                self.pushes,
                self.is_silent_while_driving,
                self.stops,
                self.time_passes,
                self.joints_are_silent,
            ),
            weights=(4, 2, 6, 3, 3, 4, 2, 4, 2),
        )[0]
        self.done.append(f"{rule.__name__} {rule()} -> {self.rig.mode}")

    def requests_lease(self) -> str:
        random = self.random
        name = random.choice(OPERATORS)
        op = random.choice(("acquire", "acquire", "release", "request", "grant", "deny"))
        fields = {"take_over": random.random() < 0.5} if op == "acquire" else {}
        if op in ("release", "grant", "deny"):
            fields = {"lease": self.leases[name], "asker": random.choice(OPERATORS)}
        self.lease(op, name, **fields)
        return f"{op} {name}"

    def lease(self, op: str, name: str, **fields: Any) -> None:
        reply = self.rig.ask(Service.LEASE, op=op, operator=name, **fields)
        if reply.granted:
            self.leases[name] = reply.lease
            self.pilots[name] = self.rig.pilot(name, reply.lease)

    def hands_over(self) -> str:
        giver, asker = self.random.sample(OPERATORS, 2)
        self.lease("request", asker)
        self.lease("grant", giver, lease=self.leases[giver], asker=asker)
        return f"{giver} to {asker}"

    def requests_as_holder(self) -> str:
        key = self.random.choice(tuple(HOLDER_SERVICES))
        name = self.random.choice(OPERATORS)
        self.rig.ask(HOLDER_SERVICES[key], lease=self.leases[name], **self.fields(key))
        return f"{key} {name}"

    def gets_ready(self) -> str:
        name = self.random.choice(OPERATORS)
        self.lease("acquire", name, take_over=True)
        if self.rig.mode in LATCHED:
            self.rig.wait(0.5)
            self.rig.ask(Service.RESET, lease=self.leases[name])
        self.rig.ask(Service.ARM, lease=self.leases[name])
        if self.random.random() < 0.2:
            return f"{name}, not yet"
        while self.rig.mode is Mode.ARMING:
            self.rig.drive(self.pilots[name], (0.0, 0.0, 0.0), 0.1)
        return name

    def pushes(self) -> str:
        if not self.pilots:
            return "with no lease"
        name = self.random.choice(tuple(self.pilots))
        seconds = self.random.choice((0.02, 0.3))
        self.rig.drive(self.pilots[name], (0.5, 0.2, 0.3), seconds)
        return name

    def is_silent_while_driving(self) -> str:
        """Drive until the robot starts an automatic stop; sometimes another operator takes over."""
        if self.rig.mode is not Mode.READY:
            self.gets_ready()
        lease = self.rig.controller.supervisor.lease_in_force(self.rig.now_s)
        if lease is not None:
            self.rig.drive(self.pilots[lease.holder], (0.8, 0.4, 0.5), 0.3)
            self.rig.wait(self.random.choice((0.1, 0.22)))
        if self.random.random() < 0.3:
            self.lease("acquire", self.random.choice(OPERATORS), take_over=True)
        return ""

    def stops(self) -> str:
        self.rig.controller.stop(b"", self.rig.now_s)
        return ""

    def time_passes(self) -> str:
        seconds = self.random.choice((0.01, 0.1, 0.25, 1.0, 3.0))
        self.rig.wait(seconds)
        return f"{seconds} s"

    def joints_are_silent(self) -> str:
        self.rig.measures = False
        self.rig.wait(0.15)
        self.rig.measures = self.random.random() < 0.8
        return f"and measured again: {self.rig.measures}"

    def fields(self, key: str) -> dict[str, Any]:
        """Request fields that only the state of the robot can make invalid."""
        if key == "speed":
            speed = self.rig.status().wheel_speed
            return {"cruise_speed_rpm": speed.requested_rpm if speed else 1000.0}
        if key == "set_pose" and self.rig.controller.kinematics.pose_type is SE2:
            return {"x_m": 1.0, "y_m": 2.0, "heading_rad": 0.5}
        return {}

    # Ask the robot itself for expected refusals, and a copy for expected successes.

    def copied(self) -> ControllerHarness:
        self.rig.controller.take_events()  # As a node does, or each copy would have all.
        robot = self.rig.controller.robot
        return copy.deepcopy(self.rig, {id(robot): robot})

    def answer(self, said: Reason | None, service: Service, **fields: Any) -> Reason | None:
        """Return the refusal of a request, or None if accepted; `said` comes from the status."""
        rig = self.copied() if said is None else self.rig
        reply = rig.ask(service, **fields)
        accepted = reply.granted if isinstance(reply, LeaseReply) else reply.ok
        return None if accepted else reply.why

    def is_moved_by(self, operator: str, lease: str) -> bool:
        """Return whether a fresh command moves the robot."""
        rig = self.copied()
        rig.controller.record_status_sent(rig.status_seq + 1, rig.now_s)
        sample = rig.sample(
            rig.pilot(operator, lease), (0.1, 0.0, 0.0), seq=10**9, status_seq=rig.status_seq + 1
        )
        rig.controller.supervisor.receive(sample, rig.now_s)
        command = rig.controller.supervisor.command
        moves = rig.mode is Mode.DRIVING and command is not None and command.seq == 10**9
        assert moves or rig.mode is self.rig.mode, "what does not move it changes no mode"
        return moves

    def check(self) -> Refusals:
        """Compare the refusals in the status with the answers, for holder and other operators."""
        refusals = self.rig.status().refusals
        assert refusals is not None
        lease = self.rig.controller.supervisor.lease_in_force(self.rig.now_s)
        holder = lease.holder if lease else STRANGER
        held = lease.id.hex() if lease else UNKNOWN_LEASE
        why = refusals.why
        answer = self.answer(why.get("lease"), Service.LEASE, op="acquire", operator=STRANGER)
        assert answer == why.get("lease"), self.done
        for key, service in HOLDER_SERVICES.items():
            for said, lease_hex in (
                (why.get(key), held),
                (why["no_lease"], "cd" * 16),
            ):
                answer = self.answer(said, service, lease=lease_hex, **self.fields(key))
                assert answer == said, (key, self.done)
        assert self.is_moved_by(holder, held) == ("drive" not in why), self.done
        assert not self.is_moved_by(STRANGER, "cd" * 16)
        return refusals


@every_robot
def test_the_status_says_what_each_service_answers_at_that_moment(name: str) -> None:
    operators = RandomOperators(name, seed=1)
    seen: dict[str, set[bytes | None]] = defaultdict(set)
    modes: set[Mode] = set()
    for _ in range(150):
        operators.act()
        refusals = operators.check()
        modes.add(operators.rig.mode)
        for key in ("lease", "no_lease", *HOLDER_SERVICES, "drive"):
            seen[key].add(encoded(refusals.why.get(key)))
    stands = operators.rig.controller.robot.wheel_speed_range is None
    for key in ("lease", *HOLDER_SERVICES, "drive"):
        accepted = key != "speed" or not stands
        assert (None in seen[key]) == accepted, (key, "never accepted or never refused")
        assert len(seen[key]) > 1, (key, "always the same")
    assert seen["no_lease"] == {
        encoded(because(Code.TAKE_CONTROL_FIRST)),
        *(encoded(because(Code.HELD_BY, holder=name)) for name in OPERATORS),
    }
    assert modes == set(Mode)
    assert encoded(because(Code.COMING_TO_REST)) in seen["drive"]
    assert any(Code.RESERVED_FOR.encode() in (reason or b"") for reason in seen["lease"])


def encoded(reason: Reason | None) -> bytes | None:
    return None if reason is None else msgspec.json.encode(reason)


def test_the_reason_of_a_fault_is_said_before_arming_is_requested() -> None:
    rig = ControllerHarness()
    pilot = rig.acquire()
    assert rig.status().refusals == Refusals.of(
        {
            "lease": because(Code.DRIVEN_BY, holder="alice"),
            "no_lease": because(Code.HELD_BY, holder="alice"),
            "reset": because(Code.NOT_LATCHED, mode="disarmed"),
            "drive": because(Code.ARM_FIRST),
        }
    )
    rig.measures = False
    rig.drive(pilot, (0.0, 0.0, 0.0), 0.2)
    refusals = rig.status().refusals
    assert refusals is not None
    assert refusals.why["arm"] == because(Code.JOINTS_SILENT, ms=100)


def test_a_reservation_refuses_all_operators_but_one() -> None:
    rig = ControllerHarness()
    pilot = rig.acquire("alice")
    rig.ask(Service.LEASE, op="request", operator="bob")
    rig.ask(Service.LEASE, op="grant", operator="alice", lease=pilot.lease, asker="bob")
    status = rig.status()
    assert status.refusals is not None
    assert status.refusals.why["lease"] == because(Code.RESERVED_FOR, operator="bob")
    assert status.lease.reserved_for == "bob"
    rig.acquire("bob")


def test_a_reset_is_refused_for_half_a_second_after_a_push() -> None:
    rig = ControllerHarness()
    pilot = rig.get_ready()
    rig.drive(pilot, (0.5, 0.0, 0.0), 0.1)
    rig.controller.stop(b"", rig.now_s)
    refused: list[Reason | None] = []
    for _ in range(60):
        rig.tick()
        status = rig.status()
        assert status.refusals is not None
        refused.append(status.refusals.why.get("reset"))
    accepted = refused.index(None)
    assert 0 < accepted < len(refused)
    assert refused[:accepted] == [because(Code.RELEASE_FIRST)] * accepted
    assert not any(refused[accepted:])


def test_coming_to_rest_only_the_operator_who_drove_goes_on() -> None:
    rig = ControllerHarness()
    alice = rig.get_ready("alice")
    rig.drive(alice, (1.0, 0.0, 0.0), 0.5)
    rig.wait(0.25)
    status = rig.status()
    assert status.refusals is not None
    assert (status.mode, status.refusals.why.get("drive")) == ("stopping", None)
    rig.acquire("bob", take_over=True)
    status = rig.status()
    assert status.refusals is not None
    assert status.mode == "stopping"
    assert status.refusals.why["drive"] == because(Code.COMING_TO_REST)
