"""Publisher of the input log of a controller."""

from __future__ import annotations

import functools
import hashlib
import logging
import platform
from pathlib import Path

import numpy as np

from tsd_twin.bus import Bus
from tsd_twin.control import LoggedController
from tsd_twin.control.logged_controller import PURE, InputBatch, encode_batch
from tsd_twin.messages import topics

_LOG = logging.getLogger(__name__)


_BATCH = 20
"""Periods per message (5 messages per second)."""
_SNAPSHOT_EVERY = 150
"""Batches between snapshots (30 s, the maximum missing at the start of a file)."""
_EARLY = 50
"""Batches buffered for a first subscriber, so that a recorder started with the node misses none."""


class InputLogPublisher:
    """Publishes the input log of a controller; without subscribers, nothing is logged.

    The first 10 s are buffered until a subscriber appears, so that its log begins with the node.
    Later logs begin with a snapshot.
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
        """Flush the log periodically; call at the end of each period."""
        self._periods += 1
        if self._periods % _BATCH == 0 and not self._failed:
            self.flush()

    def flush(self) -> None:
        """Send the log since the last message; an error ends the log but not the robot."""
        try:
            self._flush()
        except Exception:  # A failure here must not stop a moving robot.
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
    """Return a digest of the controller code, the numpy version and the processor."""
    folder = Path(__file__).parents[1]
    digest = hashlib.sha256(f"{np.__version__} {platform.machine()}".encode())
    packages = (folder / name for name in PURE)
    files = [f for p in packages for f in (p.with_suffix(".py"), *p.rglob("*.py")) if f.is_file()]
    for file in sorted(files):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]
