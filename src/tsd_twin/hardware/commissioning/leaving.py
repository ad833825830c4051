"""Signals that end commissioning through its cleanup."""

from __future__ import annotations

import signal
import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

LEAVING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C, termination and a closed terminal."""


@dataclass(slots=True)
class _State:
    held: bool = False
    pending: int = 0
    """Signal that arrived while signals were held back, or 0."""


_STATE = _State()


def leave_on_signals() -> None:
    """Exit with 128 plus the number of the first signal; later ones are ignored."""
    for number in LEAVING:
        signal.signal(number, _leave)


@contextmanager
def signals_held() -> Generator[None]:
    """Hold back signals that end the program until the end of the block.

    A signal mask would not do, because another thread of the process may receive the signal.
    """
    _STATE.held = True
    try:
        yield
    finally:
        _STATE.held = False
        if number := _STATE.pending:
            _STATE.pending = 0
            sys.exit(128 + number)


def _leave(number: int, _frame: FrameType | None) -> None:
    for each in LEAVING:  # A second signal must not interrupt the cleanup.
        signal.signal(each, signal.SIG_IGN)
    if _STATE.held:
        _STATE.pending = number
    else:
        sys.exit(128 + number)
