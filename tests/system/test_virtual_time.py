"""Virtual time is limited to the test that uses it."""

from __future__ import annotations

import threading

import pytest

from tests.support.virtual_time import VirtualClock
from tests.support.withheld import PATIENCE_S


def test_a_thread_of_an_earlier_test_does_not_advance_virtual_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begin, waited = threading.Event(), threading.Event()
    condition = threading.Condition()

    def wait_again() -> None:
        begin.wait(PATIENCE_S)
        with condition:
            condition.wait(0.01)
        waited.set()

    earlier = threading.Thread(target=wait_again)
    earlier.start()
    with monkeypatch.context() as patch:
        clock = VirtualClock(patch)
        moved: list[threading.Thread] = []
        clock.machines.append(lambda _: moved.append(threading.current_thread()))
        begin.set()
        earlier.join(PATIENCE_S)
        clock.wait(0.5)
    assert waited.is_set()
    assert moved == [threading.current_thread()]
