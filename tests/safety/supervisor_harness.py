"""Harness of the safety supervisor with time as an argument."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from tsd_twin import robots
from tsd_twin.messages.cdr import BASE, TwistStamped, encode_twist
from tsd_twin.messages.codes import hardware_reason
from tsd_twin.messages.commands import encode_attachment
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.services import LeaseReply, LeaseRequest, StopRequest
from tsd_twin.messages.topics import Sample
from tsd_twin.safety import SafetySupervisor

PERIOD_S = 0.01


class SupervisorHarness:
    """Safety supervisor in virtual time with chosen inputs: 100 steps and 20 statuses a second."""

    def __init__(self) -> None:
        ids = itertools.count(1)
        self.supervisor = SafetySupervisor(
            robots.load_robot("tsd"), lambda: next(ids).to_bytes(16, "big")
        )
        self.now_s = 1000.0
        self.inputs: dict[str, Any] = {
            "neutral": True,
            "at_speed": True,
            "at_rest": True,
            "fault": None,
        }
        self.lease = ""
        self.status_seq = 0
        self.status_sent_s: dict[int, float] = {}
        self._seq = itertools.count(1)
        self._ticks = itertools.count()
        self.step()

    @property
    def mode(self) -> Mode:
        return self.supervisor.mode

    def step(self) -> None:
        if next(self._ticks) % 5 == 0:
            self.status_seq += 1
            self.status_sent_s[self.status_seq] = self.now_s
            self.supervisor.gate.record_status(self.status_seq, self.now_s)
        self.supervisor.step(self.now_s, **self.inputs)

    def wait(self, seconds: float, **inputs: Any) -> None:
        """Advance the time with new inputs; a text is a hardware fault."""
        if "fault" in inputs:
            inputs["fault"] = hardware_reason(inputs["fault"])
        self.inputs |= inputs
        for _ in range(round(seconds / PERIOD_S)):
            self.now_s += PERIOD_S
            self.step()

    def ask(self, op: Any, operator: str = "alice", **fields: Any) -> LeaseReply:
        return self.supervisor.lease(
            LeaseRequest(op=op, operator=operator, **fields),
            self.now_s,
        )

    def acquire(self, operator: str = "alice", **fields: Any) -> str:
        """Take control; from here on commands are sent with this lease."""
        lease = self.ask("acquire", operator, **fields).lease
        assert lease is not None
        self.lease = lease
        return lease

    def send(self, *twist: float, operator: str = "alice") -> bool:
        """Send a fresh command, zero when no twist is given; return whether it counted."""
        spatial = np.zeros(6)
        spatial[: len(twist)] = twist
        before = self.supervisor.gate.accepted
        attachment = encode_attachment(next(self._seq), bytes.fromhex(self.lease), self.status_seq)
        payload = encode_twist(TwistStamped(BASE, spatial))
        self.supervisor.receive(
            Sample(f"twin/tsd/cmd/{operator}/twist", payload, attachment), self.now_s
        )
        return self.supervisor.gate.accepted > before

    def hold(self, seconds: float, *twist: float, operator: str = "alice", **inputs: Any) -> None:
        """Hold the stick: 50 commands a second."""
        for _ in range(round(seconds / PERIOD_S / 2)):
            self.send(*twist, operator=operator)
            self.wait(2 * PERIOD_S, **inputs)

    def bring_to(self, mode: Mode) -> None:
        """Take control, and reach a mode by an operator's requests."""
        self.acquire(take_over=True)
        if mode in (Mode.DISARMED, Mode.STOPPED):
            if mode is Mode.STOPPED:
                self.supervisor.stop(StopRequest("bob"), self.now_s)
            return
        assert self.supervisor.arm(self.lease, self.now_s).ok
        if mode is Mode.ARMING:
            return
        self.hold(2.5)
        if mode in (Mode.DRIVING, Mode.STOPPING):
            self.hold(0.1, 1.0, at_rest=False)
        if mode is Mode.STOPPING:
            self.wait(0.25)
        if mode is Mode.FAULT:
            self.wait(PERIOD_S, fault="it broke")
            self.wait(PERIOD_S, fault="")
        assert self.mode is mode


def stop(stage: SupervisorHarness) -> None:
    stage.supervisor.stop(StopRequest("bob"), stage.now_s)


def disarm(stage: SupervisorHarness) -> None:
    assert stage.supervisor.disarm(stage.lease, stage.now_s).ok


def reset(stage: SupervisorHarness) -> None:
    stage.wait(0.6)
    assert stage.supervisor.reset(stage.lease, stage.now_s).ok
