"""How clean a line is: a broken packet now and then is its lot, one after another is garbage."""

from __future__ import annotations

WINDOW_S = 0.5
LIMIT = 5
"""So many spoilt cycles within the window are garbage, and a line without any in it is clean.

Five of the fifty that there are at 100 Hz. A line that spoils one cycle in a thousand, which is a
bad one, gets there by chance once in years. And it is early: of packets that are broken one in
65,536 has the right sum all the same.
"""


class Noise:
    """What comes in on a line beside whole packets, cycle by cycle.

    The thread of the line notes it. What it says is replaced as a whole, and read by any thread.
    """

    def __init__(self, line: str) -> None:
        """Take what people call the line."""
        self.spoilt = 0
        """Cycles in which something was broken, of all there have been."""
        self.suspicion = ""
        """What was broken lately: why, should answers fail to come; one packet says nothing."""
        self.fault = ""
        """Why nobody should drive over this line; "" unless it is garbage."""
        self._line = line
        self._spoilt_s: list[float] = []

    def note(self, spoilt: bool, now_s: float) -> None:
        """Take in a cycle that has ended now, and whether something was broken in it."""
        self._spoilt_s = [at_s for at_s in self._spoilt_s if now_s - at_s < WINDOW_S]
        if spoilt:
            self.spoilt += 1
            self._spoilt_s.append(now_s)
        count = len(self._spoilt_s)
        if not count:
            self.suspicion = self.fault = ""
            return
        lately_s = now_s - self._spoilt_s[0]
        if count > 1:
            self.suspicion = f"garbage on {self._line}: {count} broken packets in {lately_s:.2f} s"
        if count >= LIMIT and not self.fault:
            self.fault = self.suspicion
