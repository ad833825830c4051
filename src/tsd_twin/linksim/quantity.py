"""Values with units, as people write them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal

from tsd_twin.linksim.errors import LinkError

_PATTERN = re.compile(r"(?P<number>\d+(\.\d+)?)\s*(?P<unit>[A-Za-z%]*)", re.ASCII)


@dataclass(frozen=True, slots=True)
class Quantity:
    """A kind of value that is written as a number and a unit.

    Reading and writing are exact: `parse(write(x)) == x` for every finite `x` that is not negative.
    """

    kind: str
    """What an error calls it."""
    powers: Mapping[str, int]
    """The power of ten that each unit stands for, smallest first."""
    example: str

    def parse(self, text: str) -> float:
        """Return the value in the base unit.

        Raises:
            LinkError: it is no number, or has no unit or a wrong one.
        """
        match = _PATTERN.fullmatch(text.strip())
        if match is None or match["unit"] not in self.powers:
            units = ", ".join(self.powers)
            raise LinkError(
                f"'{text}' is no {self.kind}: write a number and one of {units}, "
                f"such as {self.example}"
            )
        return float(Decimal(match["number"]).scaleb(self.powers[match["unit"]]))

    def write(self, value: float) -> str:
        """Return the value in the largest unit that leaves at least one before the point."""
        exact = Decimal(repr(float(value)))
        fitting = [unit for unit, power in self.powers.items() if exact >= Decimal(10) ** power]
        units = list(self.powers)
        unit = fitting[-1] if fitting else units[0 if exact else -1]
        return f"{exact.scaleb(-self.powers[unit]).normalize():f}{unit}"


TIME = Quantity("time", {"us": -6, "ms": -3, "s": 0}, "150ms")
SHARE = Quantity("share", {"%": -2}, "2%")
RATE = Quantity("rate", {"bit": 0, "kbit": 3, "Mbit": 6, "Gbit": 9}, "1Mbit")
