"""Whatever goes wrong while the lab drives a robot on a bus, it lets go, and the robot rests."""

from __future__ import annotations

import os
import time
from collections.abc import Callable

import numpy as np
import pytest

from tests.support.robot_node import PATIENCE_S, PATIENT, running
from tsd_twin.calibration.robot_client import CommandPublisher, RobotClient
from tsd_twin.calibration.terminal import KeyWatcher
from tsd_twin.errors import TwinError
from tsd_twin.lie import Array
from tsd_twin.messages import topics
from tsd_twin.messages.ros import decode_odometry
from tsd_twin.messages.services import LeaseRequest

pytestmark = pytest.mark.timed

SLOW = np.array([0.2, 0.0, 0.0])


def test_it_lets_go_of_the_robot_whatever_goes_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    outside, inside = os.openpty()
    with (
        os.fdopen(inside, "r") as terminal,
        running(toml=PATIENT) as node,
        node.client() as bus,
    ):
        monkeypatch.setattr("sys.stdin", terminal)
        alice = RobotClient(bus, node.id, "alice")
        truths = bus.subscriber(topics.TRUTH.key(node.id), 1)
        newest = [0.0]

        def speed_mps() -> float:
            if (sample := truths.newest()) is not None:
                newest[0] = float(decode_odometry(sample.payload).twist[0])
            return newest[0]

        def press() -> None:
            os.write(outside, b" ")

        def take_over() -> None:
            request = LeaseRequest(op="acquire", operator="alice", take_over=True)
            alice._lease = alice._call_lease_service(request).lease or ""
            assert alice._lease

        def hold_up() -> None:
            time.sleep(1.2)  # As a laptop that is closed; nothing can be awaited here.

        def refuse() -> None:
            raise TwinError("the guide says so")

        troubles: list[tuple[Callable[[], None], str]] = [
            (press, "stopped by a key"),
            (hold_up, "held up for|stopped by itself"),
            (refuse, "the guide says so"),
            (take_over, "has control|is stopping|stopped by itself"),
            (lambda: alice.stop("a cat"), "is stopped"),
        ]
        for trouble, says in troubles:
            _drive_until(RobotClient(bus, node.id, "lab"), speed_mps, trouble, says)
            _rests(speed_mps)
            if alice._lease:
                alice._disarm()
                release = LeaseRequest(op="release", operator="alice", lease=alice._lease)
                alice._lease = "" if alice._call_lease_service(release).done else "kept"
    os.close(outside)


def _drive_until(
    lab: RobotClient, speed_mps: Callable[[], float], trouble: Callable[[], None], says: str
) -> None:
    """Drive, make trouble once the robot moves, and see that it is told."""
    done = False

    def step(_now_s: float) -> Array:
        nonlocal done
        if not done and speed_mps() > 0.1:
            done = True
            trouble()
        return SLOW

    def drive() -> None:
        with KeyWatcher() as keys, lab:
            list(lab.arm())
            list(CommandPublisher(lab, keys).run(step))

    with pytest.raises(TwinError, match=says):
        drive()
    assert done


def _rests(speed_mps: Callable[[], float]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while abs(speed_mps()) > 0.01:
        assert time.monotonic() < end_s
        time.sleep(0.02)
