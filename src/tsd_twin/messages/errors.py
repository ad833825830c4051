"""Errors of messages from the bus, with the reason that a robot gives for dropping them."""

from __future__ import annotations

from tsd_twin.errors import PathError, TwinError
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.sentences import sentence


class MessageError(TwinError):
    """A peer sent an unreadable message; `reason` is the word it is counted under."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason = reason


class RejectedMessage(MessageError):  # noqa: N818  Reads as what happened.
    """A message that cannot be read or does not count; `why` is the reason for people."""

    def __init__(self, counted_as: str, why: Reason) -> None:
        """`counted_as` is the name under which the status counts it."""
        super().__init__(counted_as, sentence(why))
        self.why = why


def rejection(error: MessageError) -> Reason:
    """Reason why a message does not count."""
    if isinstance(error, RejectedMessage):
        return error.why
    return because(Code.BAD_SHAPE, detail=str(error))


def path_refusal(why: Reason) -> PathError:
    """Return an error for a path that an operator asked for."""
    return PathError(sentence(why), why)


def reason_of_path(error: PathError) -> Reason:
    """Return why a path is refused; a text if only a program can cause it."""
    if isinstance(error.why, Reason):
        return error.why
    return because(Code.PATH_REFUSED, text=str(error))
