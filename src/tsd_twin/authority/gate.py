"""The gate that every command passes, or does not: each drop is counted under one reason."""

from __future__ import annotations

import math
from collections import OrderedDict

from tsd_twin.authority.lease import Lease
from tsd_twin.errors import MessageError
from tsd_twin.messages.command import Command, Sample, decode_command
from tsd_twin.messages.status import DropCounts

_REMEMBERED = 256
"""Status messages whose sending time is kept: over a second at any rate that is sent."""


class CommandGate:
    """Says which commands count.

    A command counts only if its key names one operator, who holds the lease; the lease id is the
    current one; its number rises; the newest status it has seen was sent less than the allowed age
    ago, and not before the robot last began to stop by itself; and its numbers are finite. The
    echo of the status bounds the age of a command without any agreement between clocks, and kills
    the bursts of old commands that a stalled link replays.
    """

    def __init__(self) -> None:
        self.accepted = 0
        self.dropped = DropCounts()
        self.echo_s: float | None = None
        """Age, on arrival, of the status that the newest counted command echoes."""
        self.echoed_s = -math.inf
        """When the status was sent that the newest counted command echoes."""
        self._sent_s: OrderedDict[int, float] = OrderedDict()
        self._seen: tuple[bytes, int] = (b"", -1)
        self._stopping: tuple[bytes, float] = (b"", -math.inf)

    def note_stopping(self, now_s: float) -> None:
        """Remember when the robot began to stop by itself, and under which lease it had driven.

        What was under way then may still be young enough to count, but whoever sent it did not know
        of the stop, and may have let go since: it must not move the robot again.
        """
        self._stopping = (self._seen[0], now_s)

    def note_status(self, seq: int, now_s: float) -> None:
        """Remember when status `seq` was sent."""
        self._sent_s[seq] = now_s
        while len(self._sent_s) > _REMEMBERED:
            self._sent_s.popitem(last=False)

    def check(self, sample: Sample, lease: Lease | None, now_s: float) -> Command | MessageError:
        """Return the command if it counts, else why it does not."""
        try:
            command = decode_command(sample)
            self._check(command, lease, now_s)
        except MessageError as error:
            setattr(self.dropped, error.reason, getattr(self.dropped, error.reason) + 1)
            return error
        self._seen = (command.lease, command.seq)
        self.accepted += 1
        return command

    def _check(self, command: Command, lease: Lease | None, now_s: float) -> None:
        if lease is None or command.operator != lease.holder or command.lease != lease.id:
            holder = "nobody holds" if lease is None else f"{lease.holder} holds"
            raise MessageError("lease", f"{command.operator} sent a command, {holder} the lease")
        lease_id, newest = self._seen
        if lease_id == command.lease and command.seq <= newest:
            raise MessageError("order", f"command {command.seq} came after {newest}")
        sent_s = self._sent_s.get(command.status_seq)
        if sent_s is None:
            raise MessageError("stale", f"status {command.status_seq} was not sent lately")
        stopped_lease, stopping_s = self._stopping
        if stopped_lease == command.lease and sent_s < stopping_s:
            raise MessageError("stale", "command was sent before the stop was seen")
        if now_s - sent_s > lease.max_age_s:
            raise MessageError(
                "stale", f"command is {now_s - sent_s:.2f} s old, {lease.max_age_s:g} s are allowed"
            )
        self.echo_s, self.echoed_s = now_s - sent_s, sent_s
