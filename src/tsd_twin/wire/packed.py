"""A block of the control table as a value, and the bytes that it is on the line."""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import islice
from struct import Struct
from typing import Any, ClassVar, Self, cast


@dataclass(frozen=True, slots=True)
class Packed:
    """Numbers, and arrays of as many numbers as their default has, in the order of the bytes."""

    ADDRESS: ClassVar[int]
    LAYOUT: ClassVar[Struct]

    def pack(self) -> bytes:
        """Return the bytes of the block."""
        numbers: list[int] = []
        for field in fields(self):
            value: int | tuple[int, ...] = getattr(self, field.name)
            numbers.extend(value if isinstance(value, tuple) else (value,))
        return self.LAYOUT.pack(*numbers)

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """Return the block in these bytes."""
        numbers = iter(cls.LAYOUT.unpack(data))
        values: dict[str, Any] = {}
        for field in fields(cls):
            default = cast("int | tuple[int, ...]", field.default)
            if isinstance(default, tuple):
                values[field.name] = tuple(islice(numbers, len(default)))
            else:
                values[field.name] = next(numbers)
        return cls(**values)
