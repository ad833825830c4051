"""What all messages between page and gateway have in common."""

from __future__ import annotations

from typing import Annotated, Any, TypeAlias

import msgspec
from msgspec import Meta

Count: TypeAlias = Annotated[int, Meta(ge=0, le=2**53)]
"""A number that a browser can hold exactly."""
Triple: TypeAlias = tuple[float, float, float]


class Message(msgspec.Struct, frozen=True, tag_field="t", kw_only=True):
    """A JSON object; `t` says which."""


def encode(message: Any) -> str:
    """Return the text frame of a message; numbers that are not finite become null."""
    return msgspec.json.encode(message).decode()
