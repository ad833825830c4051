"""What happens to control, in sentences for those who watch."""

from __future__ import annotations

from tsd_twin.authority.hand_over import Claim
from tsd_twin.authority.lease import Lease, LeaseDesk
from tsd_twin.messages.service import LeaseRequest


class LeaseWords:
    """Compares what is with what was, so that also what merely runs out is said."""

    def __init__(self, desk: LeaseDesk) -> None:
        self._desk = desk
        self._holder = ""
        self._asked: Claim | None = None
        self._reserved: Claim | None = None

    def after(self, request: LeaseRequest, before: Lease | None, now_s: float) -> str:
        """Return what a request has done, an empty text when that is nothing."""
        asked, after = self._asked, self._desk.current(now_s)
        self._note(now_s)
        if after is not before:
            return self._of_change(request, before, after)
        if request.op == "keep" and asked is not None and self._asked is None:
            return f"{request.operator} keeps control, for which {asked.operator} has asked."
        if request.op == "withdraw" and asked is not None and self._asked is None:
            return f"{asked.operator} asks for control no longer."
        if self._asked is not None and self._asked is not asked:
            return f"{self._asked.operator} asks {self._holder} for control."
        return ""

    def run_out(self, now_s: float) -> str:
        """Return what has ended because its time is over, an empty text when nothing has."""
        holder, asked, reserved = self._holder, self._asked, self._reserved
        self._note(now_s)
        if holder and not self._holder:
            return f"Control of {holder} has run out."
        if asked is not None and self._asked is None:
            return f"{holder} has given no answer to {asked.operator}, who asked for control."
        if reserved is not None and self._reserved is None:
            return f"Control was kept for {reserved.operator}, who did not take it."
        return ""

    def _note(self, now_s: float) -> None:
        lease = self._desk.current(now_s)
        self._holder = lease.holder if lease else ""
        self._asked = self._desk.hand_over.asked(now_s)
        self._reserved = self._desk.hand_over.reserved(now_s)

    def _of_change(self, request: LeaseRequest, before: Lease | None, after: Lease | None) -> str:
        if after is None:
            giver = before.holder if before else "The holder"
            if self._reserved is not None:
                return f"{giver} hands control over to {self._reserved.operator}."
            return f"{giver} released control."
        if before is None or before.holder == after.holder:
            return f"{after.holder} has control."
        reason = " ".join(request.reason.split()).rstrip(".")
        why = f": {reason}" if reason else ""
        return f"{after.holder} took control over from {before.holder}{why}."
