"""Command gate: accepts or drops every velocity command, and counts drops by reason."""

from __future__ import annotations

import math
from collections import OrderedDict

from tsd_twin.errors import MessageError
from tsd_twin.messages.commands import Command, Sample, decode_command
from tsd_twin.messages.status import DropCounts
from tsd_twin.safety.lease import Lease

_REMEMBERED = 256
"""Number of status messages whose sending time is kept: more than a second of them."""


class CommandGate:
    """Filter of velocity commands by lease, order, age and finite numbers.

    A command counts only if its key names one operator, who holds the lease; the lease id is the
    current one; its number rises; the newest status it has seen was sent less than the allowed age
    ago, and not before the robot was last armed, became ready, stopped or was disarmed; and its
    numbers are finite. The echo of the status bounds the age of a command without any agreement
    between clocks, and drops the bursts of old commands that a stalled link delivers late.

    A command of zero counts however old it is, since it can only stop the robot.
    """

    def __init__(self) -> None:
        self.accepted = 0
        self.dropped = DropCounts()
        self.echo_s: float | None = None
        """Age, on arrival, of the status whose number the newest counted command carries."""
        self.echoed_s = -math.inf
        """Sending time of the status whose number the newest counted command carries."""
        self.is_late = False
        """Whether the newest counted command is a zero that is too old for any other command."""
        self._sent_s: OrderedDict[int, float] = OrderedDict()
        self._seen: tuple[bytes, int] = (b"", -1)
        self._oldest_echo_s = -math.inf

    def reject_sent_before(self, now_s: float) -> None:
        """Drop all commands, under any lease, that echo a status sent before `now_s`.

        A command in transit may be young enough to count, but its operator did not know of the stop
        or of the arming that happens now, and may have released the stick since.
        """
        self._oldest_echo_s = now_s

    def record_status(self, seq: int, now_s: float) -> None:
        """Remember when status `seq` was sent."""
        self._sent_s[seq] = now_s
        while len(self._sent_s) > _REMEMBERED:
            self._sent_s.popitem(last=False)

    def validate(self, sample: Sample, lease: Lease | None, now_s: float) -> Command | MessageError:
        """Command if it counts, else why it does not."""
        try:
            command = decode_command(sample)
            self._validate(command, lease, now_s)
        except MessageError as error:
            setattr(self.dropped, error.reason, getattr(self.dropped, error.reason) + 1)
            return error
        self._seen = (command.lease, command.seq)
        self.accepted += 1
        return command

    def _validate(self, command: Command, lease: Lease | None, now_s: float) -> None:
        if lease is None or command.operator != lease.holder or command.lease != lease.id:
            holder = "no operator holds" if lease is None else f"{lease.holder} holds"
            raise MessageError("lease", f"{command.operator} sent a command, {holder} the lease")
        lease_id, newest = self._seen
        if lease_id == command.lease and command.seq <= newest:
            raise MessageError("order", f"command {command.seq} came after {newest}")
        sent_s = self._sent_s.get(command.status_seq)
        problem = self._age_problem(command.status_seq, sent_s, lease, now_s)
        if problem and command.twist.any():
            raise MessageError("stale", problem)
        self.is_late = bool(problem)
        if sent_s is not None:
            self.echo_s, self.echoed_s = now_s - sent_s, sent_s

    def _age_problem(self, number: int, sent_s: float | None, lease: Lease, now_s: float) -> str:
        if sent_s is None:
            return f"status {number} was not sent lately"
        if sent_s < self._oldest_echo_s:
            return "command was sent before the robot last stopped or was armed"
        if now_s - sent_s > lease.max_age_s:
            return f"command is {now_s - sent_s:.2f} s old, {lease.max_age_s:g} s are allowed"
        return ""
