"""Terminal input: questions to the operator, and keys without Enter."""

from __future__ import annotations

import math
import os
import select
import sys
import termios
import time
import tty
from typing import Any, Self

import numpy as np

from tsd_twin.errors import TwinError
from tsd_twin.lie import Array


def ask_displacement() -> tuple[Array, float]:
    """Ask for the displacement (2,), metres in the start frame, and the turn in radians."""
    print_line("How far has it gone, in the directions it had at the start?")
    forward = _ask_number("forward, mm (backward: minus): ")
    left = _ask_number("to its left, mm (right: minus): ")
    turned = _ask_number("turned to the left, degrees (right: minus; count whole turns): ")
    return 0.001 * np.array([forward, left]), math.radians(turned)


def _ask_number(question: str) -> float:
    while True:
        try:
            value = float(ask_line(question))
        except ValueError:
            value = math.nan
        if math.isfinite(value):
            return value
        print_line("a number, please, such as -12.5")


def ask_line(question: str) -> str:
    """Prompt, and return the line that is typed.

    Raises:
        TwinError: the input has ended.
    """
    try:
        return input(question)
    except EOFError:
        raise TwinError("no input: the procedure needs an operator at the keyboard") from None


def ask_yes(question: str) -> bool:
    """Ask, and return whether the answer is yes."""
    return ask_line(question).strip().lower() in {"y", "yes"}


class KeyWatcher:
    """Detects key presses without Enter, if the input is a terminal; otherwise there are none.

    Ctrl-C keeps its meaning. The terminal settings are restored on exit.
    """

    def __init__(self) -> None:
        self._terminal = sys.stdin.fileno() if sys.stdin and sys.stdin.isatty() else None
        self._before: list[Any] = []

    def __enter__(self) -> Self:
        if self._terminal is not None:
            self._before = termios.tcgetattr(self._terminal)
            tty.setcbreak(self._terminal)
            # Discard keys typed before.
            termios.tcflush(self._terminal, termios.TCIFLUSH)
        return self

    def __exit__(self, *_: object) -> None:
        if self._terminal is not None:
            termios.tcsetattr(self._terminal, termios.TCSAFLUSH, self._before)

    def pressed(self, patience_s: float) -> bool:
        """Wait for a key, no longer than this, and return whether one was pressed.

        A terminal that has closed counts as a key.
        """
        if self._terminal is None:
            time.sleep(patience_s)
            return False
        ready, _, _ = select.select([self._terminal], [], [], patience_s)
        if ready:
            os.read(self._terminal, 64)
        return bool(ready)


def print_line(text: str) -> None:
    """Print a line."""
    print(text)  # noqa: T201  Output for the operator.
