"""Invariants under random actions of operators, links and joints."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    precondition,
    rule,
    run_state_machine_as_test,
)

from tests.control.invariants import LoopInvariants
from tests.control.reference_model import CommandReference
from tests.support.controller_harness import ControllerHarness, HarnessOperator
from tsd_twin import robots
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.topics import Sample, Service
from tsd_twin.simulation import SimRobot


class LoopStateMachine(LoopInvariants):
    """Sends commands to the robot and the reference model, and checks the invariants each step."""

    pilots: dict[str, HarnessOperator]
    """The latest lease of each operator."""
    letters: list[dict[str, Any]]
    """Commands in transit to the robot, as the reference model holds them."""
    old: list[tuple[Sample, dict[str, Any]]]
    """Sent commands, to be repeated."""
    seen: Mode = Mode.DISARMED
    """Mode after the last step."""

    def any_pilot(self, data: st.DataObject) -> HarnessOperator:
        return self.pilots[data.draw(st.sampled_from(sorted(self.pilots)))]

    def lease_of(self, name: str) -> str:
        return self.pilots[name].lease if name in self.pilots else "00" * 16

    def holds(self, name: str) -> bool:
        return self.referee.holds(name, self.lease_of(name), self.rig.now_s)

    def holds_the_stick(
        self, name: str, twist: tuple[float, ...], seconds: float, frame: str
    ) -> None:
        for i in range(round(seconds / 0.01)):
            if i % 2 == 0:
                self.send(name, twist, frame)
            self.tick()

    def send(self, name: str, twist: tuple[float, ...], frame: str, lease: str = "") -> None:
        rig, pilot = self.rig, self.pilots[name]
        lease = lease or pilot.lease
        seq = next(pilot.numbers)
        letter = {
            "sound": True,
            "name": name,
            "lease": lease,
            "seq": seq,
            "status_seq": rig.status_seq,
            "twist": twist,
        }
        self.post(rig.sample(pilot, twist, frame, seq=seq, lease=lease), letter)

    def post(self, sample: Sample, letter: dict[str, Any], keep: bool = True) -> None:
        self.rig.inbox.append(sample)
        self.letters.append(letter)
        if keep:
            self.old = [*self.old[-300:], (sample, letter)]

    def tick(self, dt_s: float = 0.01) -> None:
        """Run one step of the loop, compared with the reference model and the invariants."""
        before, letters, self.letters = self.rig.twist, self.letters, []
        sent_s = dict(self.rig.status_sent_s)
        self.rig.tick(dt_s)
        counted = self.referee.counted
        pushed_s = self.referee.pushed_s
        for letter in letters:
            status_sent_s = sent_s.get(letter["status_seq"], -math.inf)
            self.referee.judge(letter, self.rig.now_s, status_sent_s)
        if self.rig.mode in (Mode.STOPPED, Mode.FAULT):
            self.since_stop = []
        elif self.rig.mode is Mode.DISARMED:
            self.since_stop = ["reset"]
        elif self.referee.counted > counted and self.referee.pushed_s > pushed_s:
            self.since_stop.append("push")
        self.note_mode()
        self.hold(before, dt_s)

    def note_mode(self) -> None:
        """Report changes of the mode to the reference model."""
        mode, before = self.rig.mode, self.seen
        goes_on = mode is Mode.DRIVING or (mode is Mode.READY and before is not Mode.ARMING)
        if mode is not before and not goes_on:
            self.referee.note_interruption(self.rig.now_s)
        self.seen = mode


NAMES = ("alice", "bob", "carol")
operators = st.sampled_from(NAMES)
speeds = st.sampled_from([0.3, -1.0, 0.0, 5.0, 1e9, -1e300])
twists = st.tuples(speeds, speeds, speeds)
frames = st.sampled_from(["base_link", "odom"])
seconds = st.sampled_from([0.02, 0.1, 0.3, 0.7])


class Driving(LoopStateMachine, RuleBasedStateMachine):
    """Operators, a robot, an unreliable link, and joints that are sometimes not measured."""

    @initialize(
        name=st.sampled_from(["tsd", "tsd", "omni4", "atlas"]),
        noise=st.sampled_from([None, 0.0, 1.0]),
        ready=st.sampled_from([True, True, False]),
    )
    def switch_on(self, name: str, noise: float | None, ready: bool) -> None:
        robot = robots.load_robot(name)
        simulated = None if noise is None else SimRobot(robot, seed=1, noise=noise)
        self.rig = ControllerHarness(simulated, robot=robot)
        self.referee = CommandReference(robot.limits.max_command_age_s)
        self.pilots: dict[str, HarnessOperator] = {}
        self.leases = ["ab" * 16]
        self.letters: list[dict[str, Any]] = []
        self.old: list[tuple[Sample, dict[str, Any]]] = []
        self.since_stop: list[str] = ["reset"]  # A new robot needs no reset.
        if ready:
            self.does_all_to_drive("alice")
            assert self.rig.mode is Mode.READY

    # Actions of operators.

    @rule(name=operators, take_over=st.booleans(), max_age_s=st.sampled_from([None, 0.5, 9.0]))
    def takes_control(self, name: str, take_over: bool, max_age_s: float | None) -> None:
        now_s = self.rig.now_s
        may = self.referee.may_acquire(name, take_over, now_s)
        fields = {} if max_age_s is None else {"max_age_s": max_age_s}
        reply = self.rig.ask(
            Service.LEASE, op="acquire", operator=name, take_over=take_over, **fields
        )
        assert reply.granted == reply.done == may
        if reply.granted:
            self.pilots[name] = self.rig.pilot(name, reply.lease)
            self.leases.append(reply.lease)
            self.referee.grant(name, reply, now_s)
            self.note_mode()

    @precondition(lambda self: self.pilots)
    @rule(data=st.data(), op=st.sampled_from(["renew", "release"]))
    def renews_or_releases(self, data: st.DataObject, op: str) -> None:
        pilot = self.any_pilot(data)
        now_s = self.rig.now_s
        held = self.referee.holds(pilot.name, pilot.lease, now_s)
        reply = self.rig.ask(Service.LEASE, op=op, operator=pilot.name, lease=pilot.lease)
        assert reply.granted == (held and op == "renew")
        assert reply.done == held
        if held and op == "renew":
            self.referee.ends_s = now_s + 2.0
        elif held:
            self.referee.hand_over(now_s)
            self.note_mode()

    @rule(name=operators)
    def asks_for_control(self, name: str) -> None:
        now_s, before = self.rig.now_s, self.everything()
        may = self.referee.may_request(name, now_s)
        fresh = not self.referee.asker(now_s)
        reply = self.rig.ask(Service.LEASE, op="request", operator=name)
        assert (reply.done, reply.granted) == (may, False)
        if may and fresh:
            self.referee.asked = (name, now_s + 15.0)
        assert self.everything() == before, "a request alone changes nothing"

    @rule(name=operators)
    def asks_no_longer(self, name: str) -> None:
        now_s, before = self.rig.now_s, self.everything()
        asks = self.referee.asker(now_s) == name
        awaited = now_s < self.referee.reserved[1] and self.referee.reserved[0] == name
        done = self.rig.ask(Service.LEASE, op="withdraw", operator=name).done
        assert done == (asks or awaited)
        if asks:
            self.referee.asked = ("", now_s)
        elif awaited:
            self.referee.reserved = ("", now_s)
        assert self.everything() == before

    @precondition(lambda self: self.pilots)
    @rule(data=st.data(), asker=operators, op=st.sampled_from(["grant", "deny"]))
    def answers_who_asks(self, data: st.DataObject, asker: str, op: str) -> None:
        self.answers(self.any_pilot(data), asker, op)

    @precondition(lambda self: not self.referee.is_free(self.rig.now_s))
    @rule(name=operators, op=st.sampled_from(["grant", "grant", "deny"]), at_once=st.booleans())
    def control_is_asked_for_and_that_is_answered(self, name: str, op: str, at_once: bool) -> None:
        self.asks_for_control(name)
        holder = self.pilots[self.referee.holder or ""]
        self.answers(holder, name, op)
        if at_once:
            self.takes_control(name, take_over=False, max_age_s=None)

    def answers(self, pilot: HarnessOperator, asker: str, op: str) -> None:
        now_s, driving = self.rig.now_s, self.rig.mode is Mode.DRIVING
        may = self.referee.holds(pilot.name, pilot.lease, now_s)
        may = may and self.referee.asker(now_s) == asker
        fields = {"operator": pilot.name, "lease": pilot.lease, "asker": asker}
        reply = self.rig.ask(Service.LEASE, op=op, **fields)
        assert (reply.done, reply.granted) == (may, False)
        if may and op == "deny":
            self.referee.asked, self.referee.kept = ("", now_s), (asker, now_s + 5.0)
        elif may:
            self.referee.hand_over(now_s)
            self.note_mode()
            self.tick()
            if driving:
                assert self.rig.mode in (Mode.STOPPING, Mode.FAULT), "a grant stops the robot"

    def everything(self) -> tuple[Any, ...]:
        """State that determines motion and control."""
        supervisor, now_s = self.rig.controller.supervisor, self.rig.now_s
        lease = supervisor.lease_in_force(now_s)
        holder = lease and (lease.holder, lease.id, lease.expires_s, lease.max_age_s)
        return supervisor.mode, supervisor.command, holder, self.rig.twist.tolist()

    @rule(name=operators)
    def arms(self, name: str) -> None:
        reply = self.rig.ask(Service.ARM, lease=self.lease_of(name))
        assert not reply.ok or self.holds(name)
        if reply.ok:
            self.since_stop.append("arm")
        self.note_mode()

    @rule(name=operators)
    def disarms(self, name: str) -> None:
        reply = self.rig.ask(Service.DISARM, lease=self.lease_of(name))
        assert reply.ok == self.holds(name)
        self.note_mode()

    @rule(name=operators)
    def resets(self, name: str) -> None:
        mode, twist = self.rig.mode, self.rig.twist
        reply = self.rig.ask(Service.RESET, lease=self.lease_of(name))
        if reply.ok:
            assert self.holds(name)
            assert mode in (Mode.STOPPED, Mode.FAULT)
            assert self.rig.mode is Mode.DISARMED
            assert not twist.any()
            assert self.rig.now_s - self.referee.pushed_s >= 0.5
            self.since_stop = ["reset"]
            self.note_mode()
            self.tick()
            assert not self.rig.setpoint.any(), "a reset moves nothing"

    @rule(payload=st.sampled_from([b"", b"\xff", b'{"operator": "bob"}', b"[]"]))
    def somebody_stops(self, payload: bytes) -> None:
        assert self.rig.controller.serve(Service.STOP, payload, self.rig.now_s).ok
        assert self.rig.mode in (Mode.STOPPED, Mode.FAULT)
        self.since_stop = []
        self.note_mode()
        self.tick()
        assert not self.rig.setpoint.any(), "a stop acts at once"

    @precondition(lambda self: self.pilots)
    @rule(data=st.data(), twist=twists, seconds=seconds, frame=frames)
    def somebody_holds_the_stick(
        self, data: st.DataObject, twist: tuple[float, ...], seconds: float, frame: str
    ) -> None:
        self.holds_the_stick(self.any_pilot(data).name, twist, seconds, frame)

    @precondition(lambda self: self.rig.mode in (Mode.READY, Mode.DRIVING, Mode.STOPPING))
    @rule(name=operators, legs=st.lists(st.tuples(twists, seconds, frames), min_size=1, max_size=4))
    def the_holder_drives(self, name: str, legs: list[Any]) -> None:
        if not self.holds(self.referee.holder or ""):
            if not self.referee.may_acquire(name, True, self.rig.now_s):
                name = self.referee.reserved[0]
            self.takes_control(name, take_over=True, max_age_s=None)
        for twist, seconds, frame in legs:
            self.holds_the_stick(self.referee.holder or name, twist, seconds, frame)

    @precondition(lambda self: self.rig.mode in (Mode.READY, Mode.DRIVING))
    @rule(name=operators, twist=twists, asks=st.booleans())
    def control_changes_hands_in_full_motion_and_the_next_one_pushes(
        self, name: str, twist: tuple[float, float, float], asks: bool
    ) -> None:
        self.the_holder_drives(name="alice", legs=[((1.0, 0.0, 0.0), 0.3, "base_link")])
        if asks and not self.referee.is_free(self.rig.now_s):
            self.control_is_asked_for_and_that_is_answered(name, "grant", at_once=True)
        else:
            self.takes_control(name, take_over=True, max_age_s=None)
        if name in self.pilots:
            self.holds_the_stick(name, twist, 0.3, "base_link")

    @precondition(lambda self: len(self.pilots) > 1)
    @rule(twist=twists, seconds=seconds)
    def all_hold_their_sticks(self, twist: tuple[float, float, float], seconds: float) -> None:
        for i in range(round(seconds / 0.02)):
            for k, name in enumerate(sorted(self.pilots)):
                self.send(name, tuple(np.roll(twist, i + k)), "base_link")
            self.tick()

    @rule(name=operators)
    def does_all_to_drive(self, name: str) -> None:
        if not self.referee.may_acquire(name, True, self.rig.now_s):
            self.time_passes(3.0)  # A reservation ends.
        self.takes_control(name, take_over=True, max_age_s=None)
        if self.rig.mode in (Mode.STOPPED, Mode.FAULT):
            self.time_passes(0.5)
            self.resets(name)
        self.arms(name)
        self.holds_the_stick(name, (0.0, 0.0, 0.0), 2.8, "base_link")

    # Effects of the link.

    @precondition(lambda self: self.pilots)
    @rule(
        data=st.data(),
        wrong=st.sampled_from(["nan", "inf", "frame", "stale", "future", "body", "key"]),
    )
    def a_bad_command_arrives(self, data: st.DataObject, wrong: str) -> None:
        rig, pilot = self.rig, self.any_pilot(data)
        changed: dict[str, Any] = {}
        twist, frame = (1.0, 0.5, 1.0), "base_link"
        if wrong in ("nan", "inf"):
            twist = (float(wrong), 0.0, 0.0)
        if wrong == "frame":
            frame = "map"
        if wrong == "future":
            changed = {"status_seq": rig.status_seq + data.draw(st.integers(1, 20))}
        if wrong == "stale":
            changed = {"status_seq": data.draw(st.integers(1, rig.status_seq))}
        seq = next(pilot.numbers)
        sample = rig.sample(pilot, twist, frame, seq=seq, **changed)
        if wrong == "body":
            sample = Sample(sample.key, data.draw(st.binary(max_size=60)), sample.attachment)
        if wrong == "key":
            sample = Sample("twin/tsd/cmd/*/twist", sample.payload, sample.attachment)
        self.post(
            sample,
            {
                "sound": wrong in ("stale", "future"),
                "name": pilot.name,
                "lease": pilot.lease,
                "seq": seq,
                "status_seq": changed.get("status_seq", rig.status_seq),
                "twist": twist,
            },
        )
        self.tick()

    @precondition(lambda self: self.pilots)
    @rule(data=st.data(), name=operators, stolen=st.booleans())
    def somebody_drives_with_a_lease_that_is_not_theirs(
        self, data: st.DataObject, name: str, stolen: bool
    ) -> None:
        """Use the holder's name with another id, and the holder's id with another name."""
        holder = self.referee.holder or name
        lease = self.referee.lease if stolen else data.draw(st.sampled_from(self.leases))
        self.pilots.setdefault(name, self.rig.pilot(name, "00" * 16))
        self.send(name if stolen else holder, (1.0, 0.0, 0.0), "base_link", lease=lease)
        self.tick()

    @precondition(lambda self: self.old)
    @rule(data=st.data())
    def old_commands_arrive_again(self, data: st.DataObject) -> None:
        first = data.draw(st.integers(0, len(self.old) - 1))
        for sample, letter in self.old[first : first + 100]:
            self.post(sample, letter, keep=False)
        self.tick()

    # Time and joint measurements.

    @rule(seconds=st.sampled_from([0.01, 0.05, 0.2, 0.6, 2.5]))
    def time_passes(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.01)):
            self.tick()

    @rule()
    def all_go_for_coffee(self) -> None:
        for _ in range(25):
            self.tick(0.42)

    @rule(pause_s=st.sampled_from([0.03, 0.15, 0.3, 3.0]))
    def the_loop_stalls(self, pause_s: float) -> None:
        self.tick(pause_s)

    @rule(seconds=st.sampled_from([0.05, 0.3]))
    def the_joints_are_not_measured(self, seconds: float) -> None:
        self.rig.measures = False
        self.time_passes(seconds)
        self.rig.measures = True


def test_the_laws_hold_whatever_happens_in_whatever_order() -> None:
    run_state_machine_as_test(
        Driving,
        settings=settings(
            max_examples=30,
            stateful_step_count=30,
            phases=[Phase.reuse, Phase.generate],  # Shrinking such a script takes minutes.
            suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
        ),
    )
