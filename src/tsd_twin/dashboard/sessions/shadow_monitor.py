"""Shadow twins of the robots that are driven or looked at."""

from __future__ import annotations

import logging
import threading
import time
from contextlib import ExitStack, closing

from tsd_twin.client.connection import RobotConnection
from tsd_twin.dashboard.sessions.shadow_process import ShadowProcess, TwinSample
from tsd_twin.messages.topics import STATUS
from tsd_twin.shadow import STREAMS, ShadowReport
from tsd_twin.simulation import plants_of

IDLE_TIMEOUT_S = 60.0
"""Time a twin keeps running after its robot was last driven or shown, because a new one has to
learn the robot again."""
_PERIOD_S = 0.1
_DEPTH = 64
"""Queue size of a stream, one second of messages."""
_LOG = logging.getLogger(__name__)


class ShadowMonitor:
    """Shadow twin of a robot that runs while the robot is driven or its report requested.

    A thread passes the messages on to the process of the twins. Otherwise it has neither
    subscriptions nor a thread.
    """

    def __init__(self, link: RobotConnection, process: ShadowProcess) -> None:
        self._link = link
        self._process = process
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
        link, twin = self._link, self._process.new_twin(self._link.robot)
        with ExitStack() as open_streams:
            open_streams.callback(self._process.end, twin)
            streams = [
                (topic.path, open_streams.enter_context(closing(link.subscriber(topic, _DEPTH))))
                for topic in (STATUS, *STREAMS.values())
            ]
            while not self._ending.wait(_PERIOD_S):
                if time.monotonic() - self._asked_s > IDLE_TIMEOUT_S:
                    return
                samples = [
                    TwinSample(path, each.payload, each.attachment)
                    for path, stream in streams
                    for each in stream.take_samples()
                ]
                self._report = self._process.advance(twin, samples)
