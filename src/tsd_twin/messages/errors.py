"""Errors of messages from the bus, with the reason that a robot gives for dropping them."""

from __future__ import annotations

from tsd_twin.errors import PathError, TwinError
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.sentences import sentence


class MessageError(TwinError):
    """A peer sent a message that cannot be read or does not count."""

    def __init__(self, reason: str, detail: str | Reason) -> None:
        """`reason` is the word under which the status counts it."""
        super().__init__(f"{reason}: {detail if isinstance(detail, str) else sentence(detail)}")
        self.reason = reason
        self.why = because(Code.BAD_SHAPE, detail=str(self)) if isinstance(detail, str) else detail
        """Reason for people."""


def path_refusal(why: Reason) -> PathError:
    """Return an error for a path that an operator asked for."""
    return PathError(sentence(why), why)


def reason_of_path(error: PathError) -> Reason:
    """Return why a path is refused; a text if only a program can cause it."""
    if isinstance(error.why, Reason):
        return error.why
    return because(Code.PATH_REFUSED, text=str(error))
