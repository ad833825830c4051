"""Recorders: commands that a page puts on the bus, and waiting until all of them are processed."""

from __future__ import annotations

from tests.support.page_client import Page, Site
from tsd_twin.dashboard.sessions.teleop import ZERO_REPEATS
from tsd_twin.messages import topics
from tsd_twin.messages.commands import Command, decode_command

KEPT = 4096
"""More commands than any test sends."""


class CommandRecorder:
    """Recorder of the commands of one operator."""

    def __init__(self, served: Site, page: Page) -> None:
        self._reader = served.bus.subscriber(topics.twist_key("tsd", page.operator), KEPT)
        # Nothing that the gateway has sent before may be taken for what it sends now.
        self.take()

    def take(self) -> list[Command]:
        return [decode_command(sample) for sample in self._reader.take_samples()]


def zeros_at_the_end(commands: list[Command]) -> int:
    moving = [bool(command.twist.any()) for command in commands]
    return moving[::-1].index(True) if any(moving) else len(moving)


def is_put_to_rest(commands: list[Command]) -> bool:
    """Return whether they end with a zero, repeated only until it is acknowledged."""
    return 1 <= zeros_at_the_end(commands) <= ZERO_REPEATS // 2


def settle(page: Page) -> None:
    """Wait until all earlier messages have been processed: three states later."""
    count = len(page.all("state"))
    page.until(lambda: len(page.all("state")) >= count + 3)
