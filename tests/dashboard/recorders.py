"""Recorder of the commands that a page puts on the bus, and of the robot's acknowledgements."""

from __future__ import annotations

from tests.support.page_client import Page, Site
from tsd_twin.client.connection import numbered_status
from tsd_twin.dashboard.sessions.teleop import ZERO_REPEATS
from tsd_twin.messages import topics
from tsd_twin.messages.commands import Command, decode_command
from tsd_twin.messages.status import RobotStatus

KEPT = 4096
"""More commands than any test sends."""


class CommandRecorder:
    """Recorder of an operator's commands."""

    def __init__(self, served: Site, page: Page) -> None:
        self._operator = page.operator
        self._reader = served.bus.subscriber(topics.twist_key("tsd", page.operator), KEPT)
        self._status_reader = served.bus.subscriber(topics.STATUS.key("tsd"), KEPT)
        self._statuses: list[tuple[RobotStatus, int]] = []
        # Nothing that the gateway has sent before may be taken for what it sends now.
        self.take()

    def take(self) -> list[Command]:
        return [decode_command(sample) for sample in self._reader.take_samples()]

    def is_put_to_rest(self, commands: list[Command] | None = None) -> bool:
        """Return whether commands end with a zero, repeated only until it is acknowledged.

        Without an argument, check those not taken yet. Each zero carries the number of the latest
        status, so the result does not depend on delays.
        """
        sent = self.take() if commands is None else commands
        count = zeros_at_the_end(sent)
        if not 1 <= count <= 1 + ZERO_REPEATS:
            return False
        first, *repeated = sent[-count:]
        self._statuses += map(numbered_status, self._status_reader.take_samples())
        counted = [
            number
            for status, number in self._statuses
            if status.lease.holder == self._operator
            and first.seq <= status.command.seq <= sent[-1].seq
        ]
        return not counted or all(zero.status_seq <= counted[0] for zero in repeated)


def zeros_at_the_end(commands: list[Command]) -> int:
    moving = [bool(command.twist.any()) for command in commands]
    return moving[::-1].index(True) if any(moving) else len(moving)


def settle(page: Page) -> None:
    """Wait until all earlier messages have been processed: three states later."""
    count = len(page.all("state"))
    page.until(lambda: len(page.all("state")) >= count + 3)
