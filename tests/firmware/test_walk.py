"""Anything may happen in any order: no wheel is driven that nobody may have wanted to turn.

The oracle uses the inputs of the board, not its firmware: it decides when a pulse above zero
throttle can be right, and every other is wrong.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.support.firmware_host import CRUISE, CYCLE_S, HOLD_S, ZERO, Bench, FirmwareHost

STEPS = 80
TIMEOUT_S = 0.5 + 0.04
"""The timeout, and two pulses."""
GRACE_S = 0.15
"""A receiver is lost after 0.1 s, a servo after 0.05 s; the rest are pulses."""


class Oracle:
    """Sources that can control the joints, derived from the inputs of the board."""

    def __init__(self) -> None:
        self._zero_was_sent = False
        self._asked_since_event = False
        self._beat_s = -np.inf
        self._event_s = -np.inf
        self.obstacles: set[str] = set()
        """Conditions that exclude every source from the joints while they last."""
        self.manual = False

    def sent(self, arm: int, now_s: float, *, fresh: bool) -> None:
        if fresh:
            self._beat_s = now_s
        if not arm:
            self._zero_was_sent = True
            self._lose(now_s)
        elif self._zero_was_sent:
            self._zero_was_sent = False
            self._asked_since_event |= fresh

    def _lose(self, now_s: float) -> None:
        if self._asked_since_event:
            self._event_s = now_s
        self._asked_since_event = False

    def event(self, now_s: float) -> None:
        """An event that takes the joints from the present source."""
        self._lose(now_s)
        self._event_s = now_s

    def restarted(self, now_s: float) -> None:
        """A board that starts requires a new request, from 0 to 1."""
        self._zero_was_sent = False
        self.event(now_s)

    def allows(self, now_s: float) -> bool:
        if now_s - self._event_s < GRACE_S:
            return True
        if self.obstacles:
            return False
        pc = self._asked_since_event and now_s - self._beat_s < TIMEOUT_S
        return pc or self.manual


class Walk:
    """One robot to which anything happens."""

    def __init__(self, pilot: FirmwareHost, seed: int) -> None:
        self.pilot = pilot
        self.simulation = pilot.simulation
        self.oracle = Oracle()
        self.driven = 0
        self._random = np.random.default_rng(seed)
        self._acts: list[Callable[[], None]] = [
            *[self._start] * 3,
            *[self._drive] * 6,
            self._silence,
            self._old_news,
            self._garbage,
            self._reset,
            self._hang,
            self._kill,
            self._manual,
            self._lose,
            self._servo,
            self._contactor,
        ]

    def step(self) -> None:
        self._acts[self._random.integers(len(self._acts))]()

    def mend(self) -> None:
        """Take away what keeps the robot from driving."""
        self._kill(on=False)
        self._manual(on=False)
        for servo in self.simulation.servos:
            servo.dead = False
        self.simulation.set_contactor(closed=True)
        self.oracle.obstacles.clear()
        self._let(0.3)

    def _now_s(self) -> float:
        return self.simulation.board.now_s

    def _let(self, seconds: float) -> None:
        for _ in range(round(seconds / CYCLE_S)):
            self.simulation.run(CYCLE_S)
            self._look()

    def _look(self) -> None:
        if max(self.simulation.pulses_us()) > 1001.0:
            self.driven += 1
            assert self.oracle.allows(self._now_s()), f"driven at {self._now_s():.3f} s"

    def _cycle(self, arm: int, throttle: tuple[int, ...] = ZERO, *, fresh: bool = True) -> None:
        self.oracle.sent(arm, self._now_s(), fresh=fresh)
        goal = tuple(int(g) for g in self._random.integers(-50, 51, 6)) if arm else (0,) * 6
        self.pilot.cycle(arm, throttle, goal if throttle != ZERO else (0,) * 6, fresh=fresh)
        self._look()

    def _start(self) -> None:
        if self._random.random() < 0.7:
            self.mend()
        self._cycle(0)
        self._let(float(self._random.choice([0.2, HOLD_S], p=[0.2, 0.8])))
        self._cycle(1)
        self._drive()

    def _drive(self) -> None:
        for _ in range(self._random.integers(1, 40)):
            self._cycle(1, CRUISE)

    def _silence(self) -> None:
        self._let(float(self._random.uniform(0.05, 0.9)))

    def _old_news(self) -> None:
        for _ in range(self._random.integers(1, 80)):
            self._cycle(1, CRUISE, fresh=False)

    def _garbage(self) -> None:
        self.simulation.board.send(self._random.bytes(int(self._random.integers(1, 3000))))
        self._let(0.05)
        self.simulation.board.receive()

    def _reset(self) -> None:
        power = bool(self._random.integers(2))
        if power and "stop circuit" not in self.oracle.obstacles:
            self.simulation.power_cycle()
        else:
            self.simulation.board.reset(power=power)
        self.oracle.restarted(self._now_s())
        if power:  # A board without a receiver needs none, and this one never heard of it.
            self.oracle.obstacles.discard("lost")
        self._let(float(self._random.choice([0.05, 2.2])))

    def _hang(self) -> None:
        if self._random.random() < 0.7:
            return
        before = self.simulation.board.resets
        self.simulation.board.hang()
        self.simulation.run(0.28)
        assert self.simulation.board.resets == before + 1
        self.oracle.restarted(self._now_s() - GRACE_S + 0.02)
        self._let(float(self._random.choice([0.05, 2.2])))

    def _switches(self) -> None:
        kill = "kill" in self.oracle.obstacles
        self.simulation.set_switches(kill=kill, manual=self.oracle.manual)

    def _kill(self, *, on: bool | None = None) -> None:
        self.oracle.obstacles.discard("lost")
        on = bool(self._random.integers(2)) if on is None else on
        if on:
            self.oracle.obstacles.add("kill")
            self.oracle.event(self._now_s())
        else:
            self.oracle.obstacles.discard("kill")
        self._switches()
        self._let(0.1)

    def _manual(self, *, on: bool | None = None) -> None:
        self.oracle.obstacles.discard("lost")
        on = bool(self._random.integers(2)) if on is None else on
        if on != self.oracle.manual:
            self.oracle.event(self._now_s())
        self.oracle.manual = on
        self.simulation.set_sticks(0.0, 0.0, 0.0, 0.0)
        self._switches()
        self._let(0.1)
        self.simulation.set_sticks(0.3, 0.0, -0.2, float(self._random.random()))
        self._let(0.1)

    def _lose(self) -> None:
        self.oracle.obstacles.add("lost")
        self.oracle.event(self._now_s())
        self.simulation.lose_receiver()
        self._let(0.3)

    def _contactor(self) -> None:
        self.simulation.set_contactor(closed=False)
        self.oracle.obstacles.add("stop circuit")
        self.oracle.event(self._now_s())
        self._let(0.3)
        if self._random.integers(2):
            self.simulation.set_contactor(closed=True)
            self.oracle.obstacles.discard("stop circuit")
            self._let(float(self._random.choice([0.05, 2.2])))

    def _servo(self) -> None:
        servo = self.simulation.servos[self._random.integers(6)]
        servo.dead = True
        self.oracle.obstacles.add("servo")
        self.oracle.event(self._now_s())
        self._let(0.3)


@pytest.mark.parametrize("seed", range(3))
def test_no_wheel_is_driven_that_nobody_wanted_to_turn(
    seed: int, bench: Bench, native_bench: Bench
) -> None:
    on = bench if seed == 0 else native_bench
    walk = Walk(on.pilot(1 + seed % 2, receiver=True).get_ready(), seed)
    for _ in range(STEPS):
        walk.step()
    assert walk.driven > 30, "it has to drive, or nothing is shown"
