"""Input log of a robot node: publishes all inputs of the controller while a recorder listens."""

from __future__ import annotations

import functools
import hashlib
import logging
import platform
from pathlib import Path

import numpy as np

from tsd_twin.bus import Bus
from tsd_twin.control import LoggedController
from tsd_twin.control.logged_controller import InputBatch, encode_batch
from tsd_twin.messages import topics

_LOG = logging.getLogger(__name__)

_BATCH = 20
"""Periods in a message: five messages a second."""
_SNAPSHOT_EVERY = 150
"""Batches between two snapshots: 30 s, which a file loses at most at its beginning."""
_EARLY = 50
"""Batches that wait for a first subscriber: a recorder that is started with the node has all."""
_PURE = ("control", "safety", "estimation", "motion", "messages", "robots", "kinematics")


class InputLogPublisher:
    """Publisher of the input log of a controller; without a subscriber nothing is logged.

    The log of the first 10 s waits for one, so that it begins with the node. Later it begins with
    a snapshot.
    """

    def __init__(self, bus: Bus, robot_id: str, controller: LoggedController) -> None:
        topic = topics.INPUTS
        self._publisher = bus.publisher(topic.key(robot_id), topic.qos, topic.type)
        self._controller = controller
        self._early: list[InputBatch] | None = []
        self._periods = 0
        self._batches = 0
        self._failed = False

    def step(self) -> None:
        """Send what was logged, once in a while; called at the end of each period."""
        self._periods += 1
        if self._periods % _BATCH == 0 and not self._failed:
            self.flush()

    def flush(self) -> None:
        """Send what was logged since the last message; an error ends the log, not the robot."""
        try:
            self._flush()
        except Exception:
            _LOG.exception("the inputs of the controller are logged no longer")
            self._failed = True
            self._controller.end_log()

    def _flush(self) -> None:
        controller, wanted = self._controller, self._publisher.has_subscribers
        if controller.logs:
            self._batches += 1
            batch = controller.take_log(snapshot=wanted and self._batches % _SNAPSHOT_EVERY == 0)
            if wanted:
                for waiting in (*(self._early or ()), batch):
                    self._publisher.put(encode_batch(waiting))
                self._early = None
            elif self._early is not None and len(self._early) < _EARLY:
                self._early.append(batch)
            else:
                self._early = None
                controller.end_log()
        elif wanted:
            controller.begin_log()


@functools.cache
def build() -> str:
    """Return a digest of the code that a controller runs, numpy and the processor included."""
    folder = Path(__file__).parents[1]
    digest = hashlib.sha256(f"{np.__version__} {platform.machine()}".encode())
    files = [folder / "lie.py", *(file for name in _PURE for file in (folder / name).glob("*.py"))]
    for file in sorted(files):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]
