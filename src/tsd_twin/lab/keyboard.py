"""Questions to who sits at the keyboard."""

from __future__ import annotations

import math

import numpy as np

from tsd_twin.errors import TwinError
from tsd_twin.lie import Array


def asked() -> tuple[Array, float]:
    """Ask how far the robot went: (2,) metres, axes as it stood at first, and turned, radians."""
    say("How far has it gone, in the directions it had at the start?")
    forward = _number("forward, mm (backward: minus): ")
    left = _number("to its left, mm (right: minus): ")
    turned = _number("turned to the left, degrees (right: minus; count whole turns): ")
    return 0.001 * np.array([forward, left]), math.radians(turned)


def _number(question: str) -> float:
    while True:
        try:
            value = float(ask(question))
        except ValueError:
            value = math.nan
        if math.isfinite(value):
            return value
        say("a number, please, such as -12.5")


def ask(question: str) -> str:
    """Return a line that is typed.

    Raises:
        TwinError: nobody is there.
    """
    try:
        return input(question)
    except EOFError:
        raise TwinError("nobody answers: the procedure needs somebody at the keyboard") from None


def say(text: str) -> None:
    """Print a line."""
    print(text)  # noqa: T201  It talks to who sits there.
