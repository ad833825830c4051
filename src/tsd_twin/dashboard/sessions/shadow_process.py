"""Process with the shadow twins of a dashboard.

A twin computes about as much as the rest of the dashboard does for its robot. In this process, with
a lower priority, twins delay neither commands nor pictures. It ends with its pipe.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import pickle
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from tsd_twin.errors import TwinError
from tsd_twin.lie import SO3
from tsd_twin.messages.cdr import decode_joints, decode_odometry
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.status import decode_stamp, decode_status
from tsd_twin.messages.topics import ODOM, STATUS
from tsd_twin.robots import RobotDescription
from tsd_twin.shadow import STREAMS, ShadowFeed, ShadowReport, ShadowTwin

_LOG = logging.getLogger(__name__)
_LOWER_PRIORITY = """\
import contextlib, os
os.nice(10)
with contextlib.suppress(AttributeError, OSError):  # Not on all systems.
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
"""
"""First lines of the process. Its imports need half a second of CPU time, and it inherits a
real-time priority of the dashboard.
"""
ANSWER_TIMEOUT_S = 10.0
"""Time after which a process that does not answer is replaced."""


class TwinSample(NamedTuple):
    """Message of a robot as received."""

    path: str
    """Path of its topic."""
    payload: bytes
    attachment: bytes


class TwinKey(NamedTuple):
    """Key of a twin, from `ShadowProcess.new_twin`."""

    number: int
    robot: bytes
    """Pickled description of its robot."""


class _Request(NamedTuple):
    twin: TwinKey
    samples: Sequence[TwinSample] | None = None
    """New messages; None ends the twin."""


class ShadowProcess:
    """Process of the shadow twins, which starts with the first one; thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._numbers = itertools.count()
        self._process: subprocess.Popen[bytes] | None = None
        self._channel: Connection[_Request, ShadowReport | str] | None = None

    def new_twin(self, robot: RobotDescription) -> TwinKey:
        """Return the key of a new twin of a robot."""
        # Pickled once, which takes longer than for the messages of a period.
        return TwinKey(next(self._numbers), pickle.dumps(robot))

    def advance(self, twin: TwinKey, samples: Sequence[TwinSample]) -> ShadowReport:
        """Return the report of a twin after more messages; a new twin begins with them.

        If the process has died, its twins begin again in another one.

        Raises:
            TwinError: If the twin, or twice the process, has failed.
        """
        answer = self._ask(_Request(twin, samples))
        if isinstance(answer, str):
            raise TwinError(answer)
        return answer

    def end(self, twin: TwinKey) -> None:
        """Forget a twin."""
        if self._process is not None:
            with contextlib.suppress(TwinError):
                self._ask(_Request(twin))

    def close(self) -> None:
        """End the process."""
        with self._lock:
            self._stop()

    def _ask(self, request: _Request) -> ShadowReport | str:
        with self._lock:
            for _ in range(2):
                channel = self._channel or self._start()
                try:
                    channel.send(request)
                    if channel.poll(ANSWER_TIMEOUT_S):
                        return channel.recv()
                except (OSError, EOFError):
                    pass
                _LOG.warning("the process of the shadow twins does not answer")
                self._stop()
        raise TwinError("the process of the shadow twins does not answer")

    def _start(self) -> Connection[_Request, ShadowReport | str]:
        ours, theirs = Pipe()
        with theirs:
            # `multiprocessing` would import the whole dashboard again.
            start = f"{_LOWER_PRIORITY}from {__name__} import main; main({theirs.fileno()})"
            self._process = subprocess.Popen(  # noqa: S603  Our own program.
                [sys.executable, "-P", "-c", start],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                process_group=0,  # Ctrl-C is for the dashboard, which closes the pipe.
            )
        self._channel = ours
        return ours

    def _stop(self) -> None:
        if self._channel is not None:
            self._channel.close()
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        self._channel = self._process = None


def main(descriptor: int) -> None:
    """Answer requests until the pipe is closed."""
    twins: dict[int, _Twin] = {}
    channel: Connection[ShadowReport | str, _Request] = Connection(descriptor)
    with channel, contextlib.suppress(EOFError, OSError):
        while True:
            channel.send(_answer(twins, channel.recv()))


class _Twin:
    """Twin of a robot, with its decoders."""

    def __init__(self, robot: RobotDescription) -> None:
        self._feed = ShadowFeed(ShadowTwin(robot))
        self._turning = robot.kinematics().pose_type is SO3

    def advance(self, samples: Sequence[TwinSample]) -> ShadowReport:
        for sample in samples:
            with contextlib.suppress(MessageError):  # Any program can publish on this key.
                self._take(sample)
        return self._feed.twin.report()

    def _take(self, sample: TwinSample) -> None:
        if sample.path == STATUS.path:
            self._feed.status = decode_status(sample.payload)
            return
        if sample.path == ODOM.path:
            message: Any = decode_odometry(sample.payload, turning=self._turning)
        else:
            message = decode_joints(sample.payload)
        self._feed.add(_STREAM_OF[sample.path], message, decode_stamp(sample.attachment)[1])


_STREAM_OF: Mapping[str, str] = {topic.path: name for name, topic in STREAMS.items()}


def _answer(twins: dict[int, _Twin], request: _Request) -> ShadowReport | str:
    number, robot = request.twin
    if request.samples is None:
        twins.pop(number, None)
        return ""
    try:
        if number not in twins:
            twins[number] = _Twin(pickle.loads(robot))  # noqa: S301  The dashboard made it.
        return twins[number].advance(request.samples)
    except Exception as error:  # The description and the messages come from the bus.
        _LOG.exception("a shadow twin has failed")
        twins.pop(number, None)
        return f"a shadow twin has failed: {error}"
