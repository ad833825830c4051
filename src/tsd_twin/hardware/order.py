"""What the joints shall do, on its way from the node's thread to that of a port."""

from __future__ import annotations

from dataclasses import dataclass

from tsd_twin.authority import Mandate
from tsd_twin.lie import Array

ORDER_TIMEOUT_S = 0.25
"""A node that has given no order for this long hangs: its last one is not obeyed any more."""


@dataclass(frozen=True, slots=True)
class Order:
    """One set-point, and on whose word it is given."""

    setpoint: Array
    """(n,)."""
    mandate: Mandate
    given_s: float
    """On the monotonic clock."""

    def in_force(self, now_s: float) -> bool:
        """Return whether it may still be obeyed."""
        return now_s - self.given_s <= ORDER_TIMEOUT_S
