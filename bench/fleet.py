"""A slow viewer and a stopped one at a router, while five of twenty robots drive.

Both viewers read all states through the router. The slow one is behind 0.5 Mbit/s and asks for the
descriptions of all robots again and again; the other is a process that was stopped. One more robot
publishes messages that wait for slow readers, unless the router prevents it.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Generator, Iterator
from contextlib import ExitStack, contextmanager

from bench.bus import paced_speeds, watch_setpoint
from bench.programs import counter, peer, python, tool, until
from bench.router import DRIVEN, RoutedFleet, push, routed_fleet
from bench.table import Row, Run, percentile
from tsd_twin.bus import Bus, from_file
from tsd_twin.messages import topics
from tsd_twin.messages.status import CommandStatus, decode_status
from tsd_twin.messages.topics import Sample

_LINK = "bandwidth=0.5Mbit"
_REQUIRED, _ADDED_MS = 99.5, 3.0
"""Commands that must arrive, percent, and allowed delay in addition to that without viewers."""
_BLOCKING = "block1"
_ROUNDS = 3


def rows(run: Run) -> Iterator[Row]:
    """Drive for a minute with the viewers, and as long without them."""
    count = int(run.pick(3000, 20))
    received: list[float] = []
    with routed_fleet(_BLOCKING) as fleet, ExitStack() as stack:
        bus = stack.enter_context(Bus(from_file(str(fleet.config))))
        config = str(fleet.folder / f"{_BLOCKING}.json5")
        stack.enter_context(peer("blocking_robot", config, _BLOCKING))
        commands = Commands(bus)
        came = watch_setpoint(bus, "lab1")
        base = stack.enter_context(stack.enter_context(fleet.connected("lab1")).control())
        push(base, 0.4)  # A new lease begins at a higher number.
        until(commands.all_drive)

        def drive() -> tuple[float, float]:
            with commands:
                delays_ms = paced_speeds(lambda vx_mps: push(base, vx_mps), came, count)
            return commands.arrived, percentile(delays_ms, 0.99)

        def watched() -> tuple[float, float]:
            results: list[tuple[float, float]] = []
            with viewers(fleet) as slow:
                counts = slow.during(lambda: results.append(drive()))
            received.append(counts["kB_s"])
            return results[0]

        yield from run.alternate(
            ["fleet.slow_arrived", "fleet.slow_p99"],
            watched,
            lambda: (_REQUIRED, drive()[1] + _ADDED_MS),
            rounds=_ROUNDS,
            note=lambda: f"the slow viewer received {max(received):.0f} kB/s",
        )


@contextmanager
def viewers(fleet: RoutedFleet) -> Generator[counter]:
    """Run a slow viewer, which is returned, and a stopped one."""
    config, at = str(fleet.config), fleet.endpoint
    with tool("tsd_link", "--link", _LINK, "--target", at.replace("tls/", "tcp/")) as link:
        slow = counter(python("bench.peers", "viewer", config, link.replace("tcp/", "tls/")))
        stopped = peer("viewer", config, at)
        with slow, stopped:
            os.kill(stopped.process.pid, signal.SIGSTOP)
            try:
                yield slow
            finally:
                os.kill(stopped.process.pid, signal.SIGCONT)


class Commands:
    """Commands that arrived at the driven robots within `with`, from their states."""

    arrived = 0.0
    """Percent."""

    def __init__(self, bus: Bus) -> None:
        self._latest: dict[str, CommandStatus] = {}
        for robot in DRIVEN:
            bus.subscribe(topics.STATUS.key(robot), self._note)

    def all_drive(self) -> bool:
        """Return whether each of the robots has accepted a command."""
        return all(robot in self._latest and self._latest[robot].accepted for robot in DRIVEN)

    def __enter__(self) -> None:
        self._before = dict(self._latest)

    def __exit__(self, *_: object) -> None:
        pairs = [(self._before[robot], self._latest[robot]) for robot in DRIVEN]
        sent = sum(after.seq - before.seq for before, after in pairs)
        self.arrived = 100.0 * sum(b.accepted - a.accepted for a, b in pairs) / sent

    def _note(self, sample: Sample) -> None:
        self._latest[topics.robot_of(sample.key)] = decode_status(sample.payload).command
