"""Command gate: which samples count as commands."""

from __future__ import annotations

import math
from collections import OrderedDict

from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.commands import Command, decode_command
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.status import DropCounts
from tsd_twin.messages.topics import Sample
from tsd_twin.safety.lease import Lease

_REMEMBERED = 256
"""Number of status send times kept (more than a second)."""


class CommandGate:
    """Validates velocity commands: lease, order, age and finite values.

    A command is accepted if all of these hold:
    - the operator in its key holds the lease, and the lease id matches;
    - its sequence number increases, and all values are finite;
    - the status it echoes was sent within the maximum age, and after the robot last armed, became
      ready, stopped or disarmed.

    The echoed status bounds the command's age without synchronized clocks, and rejects the bursts
    of stale commands that a stalled link delivers. Zero commands are accepted at any age because
    they can only stop the robot.
    """

    def __init__(self) -> None:
        self.accepted = 0
        self.dropped = DropCounts()
        self.echo_s: float | None = None
        """Age on arrival of the status echoed by the latest accepted command."""
        self.echoed_s = -math.inf
        """Send time of the status echoed by the latest accepted command."""
        self.is_stale_zero = False
        """Whether the latest accepted command is a zero older than the maximum age."""
        self.is_overaged = False
        """Whether a command echoed too old a status, and no fresh command followed."""
        self.overaged_s: float | None = None
        """Send time of that status, or None if no longer known."""
        self._sent_s: OrderedDict[int, float] = OrderedDict()
        self._seen: tuple[bytes, int] = (b"", -1)
        self._oldest_echo_s = -math.inf

    def reject_sent_before(self, now_s: float) -> None:
        """Reject all commands, under any lease, that echo a status sent before `now_s`.

        Commands in flight may be fresh enough, but their operator did not know about the current
        stop or arming, and may have released the stick since.
        """
        self._oldest_echo_s = now_s

    def record_status(self, seq: int, now_s: float) -> None:
        """Record the send time of status `seq`."""
        self._sent_s[seq] = now_s
        while len(self._sent_s) > _REMEMBERED:
            self._sent_s.popitem(last=False)

    def validate(self, sample: Sample, lease: Lease | None, now_s: float) -> Command | MessageError:
        """Return the command if it is accepted, else the error."""
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
            raise MessageError("lease", _not_holder(command.operator, lease))
        lease_id, newest = self._seen
        if lease_id == command.lease and command.seq <= newest:
            late = because(Code.OUT_OF_ORDER, number=command.seq, latest=newest)
            raise MessageError("order", late)
        sent_s = self._sent_s.get(command.status_seq)
        if sent_s is None or now_s - sent_s > lease.max_age_s:
            self.is_overaged, self.overaged_s = True, sent_s
        problem = self._age_problem(command.status_seq, sent_s, lease, now_s)
        if problem is not None and command.twist.any():
            raise MessageError("stale", problem)
        self.is_stale_zero = problem is not None
        if problem is None:
            self.is_overaged = False
        if sent_s is not None:
            self.echo_s, self.echoed_s = now_s - sent_s, sent_s

    def _age_problem(
        self, number: int, sent_s: float | None, lease: Lease, now_s: float
    ) -> Reason | None:
        if sent_s is None:
            return because(Code.UNKNOWN_STATUS, number=number)
        if sent_s < self._oldest_echo_s:
            return because(Code.SENT_BEFORE_CHANGE)
        if now_s - sent_s > lease.max_age_s:
            return because(Code.TOO_OLD, s=now_s - sent_s, limit_s=lease.max_age_s)
        return None


def _not_holder(operator: str, lease: Lease | None) -> Reason:
    if lease is None:
        return because(Code.NO_LEASE, operator=operator)
    return because(Code.NOT_HOLDER, operator=operator, holder=lease.holder)
