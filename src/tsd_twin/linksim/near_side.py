"""The socket of a client."""

from __future__ import annotations

from tsd_twin.linksim.lane import Lane
from tsd_twin.linksim.side import Mark, Payload, Side, TcpSegment


class NearSide(Side):
    """Holds what a client sends before the target has answered.

    The kernel accepts at once; a handshake over the link would have taken a round trip.
    """

    def __init__(self, lane: Lane[TcpSegment], sides: set[Side]) -> None:
        super().__init__(lane, sides)
        self._is_open = False
        self._early: list[Payload] = []

    @property
    def waiting_bytes(self) -> int:
        """Read here and not yet handed over."""
        early_bytes = sum(len(payload) for payload in self._early if isinstance(payload, bytes))
        return early_bytes + super().waiting_bytes

    def carry(self, payload: Payload) -> None:
        """Send a payload to the other side, or keep it until there is one."""
        if self._is_open or payload is Mark.OPEN:
            super().carry(payload)
        elif payload is Mark.RESET:
            self.other.abandon()  # The client has given up: nobody calls any more.
            self._lane.resenders.discard(self._stream)
        else:
            self._early.append(payload)

    def opened(self) -> None:
        """Send what has waited for the handshake, unless the client has given up."""
        if self._abandoned:
            return
        self._is_open = True
        early, self._early = self._early, []
        for payload in early:
            self.carry(payload)
