"""Meeting robots that have come: all at once, and each again until it answers."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

_LOG = logging.getLogger(__name__)

MOST_WAITING = 1024
"""Robots that have not answered yet; when more come, the one gives way that failed most often."""
FIRST_S, LONGEST_S = 0.5, 30.0
"""Time until a robot that has not answered is asked again: twice as long each time."""
_GIVEN_UP_S = 5.0
"""A question that has had no end for so long is asked again."""

Take = Callable[[bytes | None], None]
"""Takes the answer of a robot, None when there is none."""


@dataclass(slots=True)
class _Turn:
    """When a robot is asked next."""

    number: int
    """Rises with each coming."""
    due_s: float
    failures: int = 0


class Acquaintance:
    """Has every robot asked that has come, and what it answers looked at.

    No question is waited for, so no robot waits for the silence of others. One thread does it all.
    """

    def __init__(
        self, ask: Callable[[str, Take], None], meet: Callable[[str, bytes], None]
    ) -> None:
        """`ask` sends a question and does not wait; `meet` takes the answer, on a thread of this.

        The answer may come on any thread.
        """
        self._ask, self._meet = ask, meet
        self._turns: dict[str, _Turn] = {}
        self._answers: deque[tuple[str, int, bytes | None]] = deque(maxlen=MOST_WAITING)
        self._comings = 0
        self._changed = threading.Condition()
        threading.Thread(target=self._work, name="fleet", daemon=True).start()

    def come(self, robot_id: str) -> None:
        """Have a robot met, now; also one that has been met before, since it may be another."""
        with self._changed:
            self._comings += 1
            turn = self._turns.get(robot_id)
            if turn is None:
                if len(self._turns) >= MOST_WAITING:
                    del self._turns[max(self._turns, key=lambda each: self._turns[each].failures)]
                turn = self._turns[robot_id] = _Turn(0, 0.0)
            turn.number, turn.due_s = self._comings, time.monotonic()
            self._changed.notify()

    def go(self, robot_id: str) -> None:
        """Do not ask a robot any more."""
        with self._changed:
            self._turns.pop(robot_id, None)

    def _answered(self, robot_id: str, number: int, answer: bytes | None) -> None:
        with self._changed:
            self._answers.append((robot_id, number, answer))
            self._changed.notify()

    def _work(self) -> None:
        while True:
            questions, answer = self._next()
            try:
                for robot_id, number in questions:
                    self._ask(robot_id, partial(self._answered, robot_id, number))
                if answer is not None:
                    self._meet(*answer)
            except Exception:  # A robot that cannot be met must not end the thread for others.
                _LOG.exception("a robot cannot be met")

    def _next(self) -> tuple[list[tuple[str, int]], tuple[str, bytes] | None]:
        """Wait, and return whom to ask now, and an answer to look at."""
        with self._changed:
            while True:
                answer = self._answer()
                now_s = time.monotonic()
                due = [(name, turn) for name, turn in self._turns.items() if turn.due_s <= now_s]
                for _, turn in due:
                    turn.due_s = now_s + _GIVEN_UP_S
                if due or answer is not None:
                    return [(name, turn.number) for name, turn in due], answer
                next_s = min((turn.due_s for turn in self._turns.values()), default=None)
                self._changed.wait(None if next_s is None else next_s - now_s)

    def _answer(self) -> tuple[str, bytes] | None:
        """Return an answer of a robot that is waited for, and put off those that gave none."""
        while self._answers:
            robot_id, number, answer = self._answers.popleft()
            turn = self._turns.get(robot_id)
            if turn is None or turn.number != number:
                continue  # It has gone, or come again and been asked again.
            if answer is not None:
                del self._turns[robot_id]
                return robot_id, answer
            turn.due_s = time.monotonic() + min(FIRST_S * 2.0**turn.failures, LONGEST_S)
            turn.failures = min(turn.failures + 1, 16)
        return None
