"""Control that is asked for and handed over, instead of being taken."""

from __future__ import annotations

from dataclasses import dataclass

ASK_S = 15.0
"""A request that nobody answers ends after this."""
RESERVE_S = 3.0
"""For so long after a grant nobody but the asker gets the lease."""
KEPT_S = 5.0
"""Who was told that control is kept may ask again after this."""


@dataclass(frozen=True, slots=True)
class Claim:
    """What one operator has for some time."""

    operator: str
    since_s: float
    until_s: float


class HandOver:
    """One request at a time, addressed to the holder, and what became of it.

    A request alone changes nothing. A grant ends the lease of the holder and keeps the next one for
    the asker alone, who takes it like any other: so its id is told to nobody else, and no lease is
    ever in force whose holder does not know of it.
    """

    def __init__(self) -> None:
        self._asked: Claim | None = None
        self._reserved: Claim | None = None
        self._kept: Claim | None = None

    def asked(self, now_s: float) -> Claim | None:
        """Return who asks the holder for control, if anybody does."""
        self._asked = _valid(self._asked, now_s)
        return self._asked

    def reserved(self, now_s: float) -> Claim | None:
        """Return for whom control is kept, if for anybody."""
        self._reserved = _valid(self._reserved, now_s)
        return self._reserved

    def ask(self, operator: str, now_s: float) -> str:
        """Ask for control; return why that cannot be. To ask twice is to ask once."""
        asked = self.asked(now_s)
        self._kept = _valid(self._kept, now_s)
        if self._kept is not None and self._kept.operator == operator:
            return f"control was kept: ask again in {self._kept.until_s - now_s:.0f} s"
        if asked is not None and asked.operator != operator:
            return f"{asked.operator} asks already"
        if asked is None:
            self._asked = Claim(operator, now_s, now_s + ASK_S)
        return ""

    def withdraw(self, operator: str, now_s: float) -> str:
        """Ask no longer, or want no longer what was granted; return why that cannot be."""
        asked, reserved = self.asked(now_s), self.reserved(now_s)
        if asked is not None and asked.operator == operator:
            self._asked = None
        elif reserved is not None and reserved.operator == operator:
            # The grant was under way when they left: nobody else shall wait for them.
            self._reserved = None
        else:
            return f"{operator} does not ask for control"
        return ""

    def keep(self, asker: str | None, now_s: float) -> str:
        """Decline the request of `asker`; return why that cannot be."""
        if refusal := self._not_asked_by(asker, now_s):
            return refusal
        self._asked, self._kept = None, Claim(asker or "", now_s, now_s + KEPT_S)
        return ""

    def grant(self, asker: str | None, now_s: float) -> str:
        """Keep the next lease for `asker`; return why that cannot be."""
        if refusal := self._not_asked_by(asker, now_s):
            return refusal
        self._asked, self._reserved = None, Claim(asker or "", now_s, now_s + RESERVE_S)
        return ""

    def end(self) -> None:
        """Forget all: the lease that was asked for has ended, or there is a new one."""
        self._asked = self._reserved = self._kept = None

    def _not_asked_by(self, asker: str | None, now_s: float) -> str:
        asked = self.asked(now_s)
        if asked is None:
            return "nobody asks for control"
        # The holder has answered one person, who may have been followed by another since.
        return "" if asked.operator == asker else f"it is {asked.operator} who asks"


def _valid(claim: Claim | None, now_s: float) -> Claim | None:
    return claim if claim is not None and now_s < claim.until_s else None
