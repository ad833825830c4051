"""After any failure of a guided drive, control is released and the robot is at rest."""

from __future__ import annotations

import os
import time
from collections.abc import Callable

import numpy as np
import pytest

from tests.support.robot_node import PATIENT, running
from tests.support.withheld import PATIENCE_S
from tsd_twin import connect
from tsd_twin.calibration.operator import (
    hold_control,
    interruptible,
    longest_pause_s,
    watch_keys,
)
from tsd_twin.client import RobotClient
from tsd_twin.client.bus_port import BusLink
from tsd_twin.errors import TwinError
from tsd_twin.lie import Array

pytestmark = pytest.mark.timed

SLOW = np.array([0.2, 0.0, 0.0])


def test_it_lets_go_of_the_robot_whatever_goes_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    outside, inside = os.openpty()
    with (
        os.fdopen(inside, "r") as terminal,
        running(toml=PATIENT) as node,
        connect(node.endpoint) as other,
    ):
        monkeypatch.setattr("sys.stdin", terminal)
        alice = other.control("alice", take_over=True, arm=False)

        def speed_mps() -> float:
            truth = other.state.truth
            return 0.0 if truth is None else truth.twist.vx_mps

        def press() -> None:
            os.write(outside, b" ")

        def hold_up() -> None:
            time.sleep(1.2)  # Like a laptop closed suddenly, so nothing can be awaited here.

        def refuse() -> None:
            raise TwinError("the guide says so")

        troubles: list[tuple[Callable[[], None], str]] = [
            (press, "stopped by a key"),
            (hold_up, "held up for|stopped by itself"),
            (refuse, "the guide says so"),
            (alice.acquire, "has control|is stopping|stopped by itself"),
            (lambda: other.stop("a cat"), "is stopped"),
        ]
        for trouble, says in troubles:
            with RobotClient(BusLink(node.client(), node.id), "lab") as lab:
                _drive_until(lab, speed_mps, trouble, says)
                _until(lambda: abs(speed_mps()) < 0.01)
                _until(lambda lab=lab: lab.state.lease.holder != "lab")
            alice.release()
    os.close(outside)


def _drive_until(
    lab: RobotClient, speed_mps: Callable[[], float], trouble: Callable[[], None], says: str
) -> None:
    """Drive, cause trouble once the robot moves, and check the error."""
    done = False

    def step(_now_s: float) -> Array:
        nonlocal done
        if not done and speed_mps() > 0.1:
            done = True
            trouble()
        return SLOW

    def drive() -> None:
        with watch_keys() as pressed, hold_control(lab, "lab") as control:
            list(control.arming())
            pause_s = longest_pause_s(lab.description.limits, None)
            list(control.driving(interruptible(step, pressed, pause_s)))

    with pytest.raises(TwinError, match=says):
        drive()
    assert done


def _until(condition: Callable[[], bool]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.02)
