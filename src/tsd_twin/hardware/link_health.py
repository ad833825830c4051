"""Health of a serial line: round trips, missed responses and the rate of packet errors. Pure."""

from __future__ import annotations

import math
from collections import deque

from tsd_twin.messages.codes import Code, Reason, Type, because
from tsd_twin.messages.sentences import WORDS

WINDOW_S = 0.5
LIMIT = 5
"""Corrupt cycles within the window at which the line is faulty.

The fault clears when the window has none. The limit is 5 of 50 cycles at 100 Hz: a poor line with
one corrupt cycle in 1000 reaches it by chance once in years. It is low because one corrupt packet
in 65,536 passes the checksum.
"""
_REMEMBERED = 500
SILENT_S = 0.1
"""Maximum age of a report."""


class LinkHealth:
    """Connection to a device on a serial line: round trips, missed responses and packet errors.

    Updated by the I/O thread only. Reasons are replaced as a whole, and any thread may read them.
    """

    def __init__(self, device: str) -> None:
        """`device` is the word for the device in reasons."""
        self.name = WORDS[Type.DEVICE][device]
        self.corrupt = 0
        """Total cycles with a corrupt packet."""
        self.suspicion: Reason | None = None
        """Two or more recent corrupt packets, a likely cause of missing responses, or None."""
        self.packet_fault: Reason | None = None
        """Fault while the error rate is above the limit, or None."""
        self.disconnect_reason = ""
        """Reason of a lost connection, or ""."""
        self._device = device
        self._corrupt_s: list[float] = []
        self._trips_ms: deque[float] = deque(maxlen=_REMEMBERED)
        self._cycles = self._missed = self._reconnects = 0

    def add_round_trip(self, trip_s: float) -> None:
        """Record a cycle with a complete response after `trip_s`."""
        self._cycles += 1
        self._trips_ms.append(1000.0 * trip_s)

    def add_timeout(self) -> None:
        """Record a cycle without a complete response."""
        self._cycles += 1
        self._missed += 1

    def add_packets(self, corrupt: bool, now_s: float) -> None:
        """Record whether a cycle contained a corrupt packet."""
        self._corrupt_s = [at_s for at_s in self._corrupt_s if now_s - at_s < WINDOW_S]
        if corrupt:
            self.corrupt += 1
            self._corrupt_s.append(now_s)
        count = len(self._corrupt_s)
        if not count:
            self.suspicion = self.packet_fault = None
            return
        lately_s = now_s - self._corrupt_s[0]
        if count > 1:
            self.suspicion = because(Code.LINE_GARBAGE, line=self._device, count=count, s=lately_s)
        if count >= LIMIT and self.packet_fault is None:
            self.packet_fault = self.suspicion

    def add_disconnect(self, reason: str) -> None:
        """Record a lost connection, or a failed attempt to connect again."""
        self.disconnect_reason = reason
        self._reconnects += 1

    def connection_fault(self, reported_s: float | None, now_s: float) -> Reason | None:
        """Return the connection fault, or None while reports are recent and the line is clean.

        `reported_s` is the time of the latest report, or None if not connected.
        """
        if reported_s is None:
            text = self.disconnect_reason
            return because(Code.DEVICE_DISCONNECTED, device=self._device, text=text)
        if self.packet_fault is not None or now_s - reported_s <= SILENT_S:
            return self.packet_fault
        silent = because(Code.DEVICE_SILENT, device=self._device, ms=1000.0 * SILENT_S)
        return self.suspicion or silent

    def status(self) -> dict[str, object]:
        """Return statistics for the status; round trips in milliseconds."""
        # Copy first, because another thread may append.
        trips = sorted(self._trips_ms.copy())
        figures: dict[str, object] = {"cycles": self._cycles, "missed": self._missed}
        figures["broken"] = self.corrupt
        figures["reconnects"] = self._reconnects
        if trips:
            figures["round_trip_ms"] = round(trips[len(trips) // 2], 2)
            figures["round_trip_p99_ms"] = round(trips[math.ceil(0.99 * len(trips)) - 1], 2)
        return figures
