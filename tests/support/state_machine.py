"""State machine for property tests of the control loop: operators, messages and loop steps."""

from __future__ import annotations

import math
from typing import Any

from hypothesis import strategies as st

from tests.support.controller_harness import HarnessOperator
from tests.support.invariants import LoopInvariants
from tsd_twin.messages.commands import Sample
from tsd_twin.messages.modes import Mode


class LoopStateMachine(LoopInvariants):
    """Sends commands to the robot and the reference model, and checks the invariants each step."""

    pilots: dict[str, HarnessOperator]
    """The newest lease that each operator was granted."""
    letters: list[dict[str, Any]]
    """What is on its way to the robot, as the referee sees it."""
    old: list[tuple[Sample, dict[str, Any]]]
    """What has been sent before, to be sent again."""
    seen: Mode = Mode.DISARMED
    """The mode after the last thing that happened."""

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
