"""Shadow twins of the robots that are driven or looked at."""

from __future__ import annotations

import logging
import threading
import time
from contextlib import ExitStack, closing
from typing import Any

from tsd_twin.bus import Subscriber
from tsd_twin.client.connection import RobotConnection
from tsd_twin.messages.cdr import decode_joints
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.status import decode_stamp, decode_status
from tsd_twin.messages.topics import ODOM, STATUS, Sample, Topic
from tsd_twin.shadow import STREAMS, ShadowFeed, ShadowReport, ShadowTwin
from tsd_twin.simulation import plants_of

IDLE_TIMEOUT_S = 60.0
"""Time a twin keeps running after its robot was last driven or shown, because a new one has to
learn the robot again."""
_PERIOD_S = 0.1
_DEPTH = 64
"""Queue size of a stream, one second of messages."""
_LOG = logging.getLogger(__name__)


class ShadowMonitor:
    """Shadow twin of a robot, on its own thread while the robot is driven or its report requested.

    Otherwise it has neither subscriptions nor a thread.
    """

    def __init__(self, link: RobotConnection) -> None:
        self._link = link
        self._lock = threading.Lock()
        self._asked_s = 0.0
        self._thread: threading.Thread | None = None
        self._ending = threading.Event()
        self._report: ShadowReport | None = None

    def report(self) -> ShadowReport | None:
        """Return the latest report and keep the twin running.

        Returns None before the first report, and for a robot that cannot be simulated.
        """
        self.follow()
        with self._lock:
            return self._report

    def follow(self) -> None:
        """Keep the twin running, or start it."""
        if not plants_of(self._link.robot):
            return
        with self._lock:
            self._asked_s = time.monotonic()
            if self._thread is None and not self._ending.is_set():
                self._thread = threading.Thread(target=self._run, name="shadow", daemon=True)
                self._thread.start()

    def end(self) -> None:
        """Make the thread end permanently."""
        self._ending.set()

    def close(self) -> None:
        """End the thread permanently and wait for it."""
        self.end()
        thread = self._thread
        if thread is not None:
            thread.join()

    def _run(self) -> None:
        try:
            self._compare()
        except Exception:  # The description and the messages come from the bus.
            _LOG.exception("the shadow twin of %s has ended", self._link.id)
            self._ending.set()
        finally:
            with self._lock:
                self._thread, self._report = None, None

    def _compare(self) -> None:
        link, feed = self._link, ShadowFeed(ShadowTwin(self._link.robot))
        with ExitStack() as open_streams:

            def subscribed(topic: Topic) -> Subscriber:
                return open_streams.enter_context(closing(link.subscriber(topic, _DEPTH)))

            statuses = subscribed(STATUS)
            streams = {name: subscribed(topic) for name, topic in STREAMS.items()}
            while not self._ending.wait(_PERIOD_S):
                if time.monotonic() - self._asked_s > IDLE_TIMEOUT_S:
                    return
                if (sample := statuses.newest()) is not None:
                    feed.status = _decoded(link, STATUS, sample) or feed.status
                for name, stream in streams.items():
                    for each in stream.take_samples():
                        message = _decoded(link, STREAMS[name], each)
                        if message is not None:
                            feed.add(name, *message)
                self._report = feed.twin.report()


def _decoded(link: RobotConnection, topic: Topic, sample: Sample) -> Any:
    """Decode a status, or another message with its time on the robot's monotonic clock.

    Returns None for an invalid message, because any program can publish on this key.
    """
    try:
        if topic is STATUS:
            return decode_status(sample.payload)
        decode = link.decode_odometry if topic is ODOM else decode_joints
        return decode(sample.payload), decode_stamp(sample.attachment)[1]
    except MessageError:
        return None
