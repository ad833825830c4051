"""One serial line with Dynamixel devices on it: questions and answers."""

from __future__ import annotations

import time

from tsd_twin.hardware.errors import PortError
from tsd_twin.hardware.port import GONE, open_port
from tsd_twin.wire import protocol2
from tsd_twin.wire.decoder import Decoder, Framing
from tsd_twin.wire.packet import Status

_READ_S = 0.002
"""How long one read waits: a fraction of a cycle, so that the time for an answer is kept."""
_CHUNK = 4096
_LONGEST_DRAIN = 5.0
_LONGEST_REST = 256
"""Of an answer that came too late, no more than so many bytes can stand before the next one."""


class Line:
    """An open port. Used by one thread, which closes it too: pyserial's `close` is not safe."""

    def __init__(self, name: str, baud: int) -> None:
        """Open the port.

        Raises:
            PortError: it cannot be opened.
        """
        self.name = name
        self._port = open_port(name, baud, _READ_S)
        self._late = True  # What stands there already is for whom the port was open before.
        self.broken = 0
        """Answers that were broken, and bytes between them that nobody should have sent."""

    def ask(
        self,
        request: bytes,
        answers: int,
        patience_s: float,
        framing: Framing = protocol2,
    ) -> list[Status]:
        """Send a request, and return the answers that came, fewer when time has run out.

        Raises:
            PortError: the port is gone.
        """
        decoder = Decoder(framing)
        rest = _LONGEST_REST if self._late else 0
        try:
            if self._late:  # What comes now may be the answer to an older question.
                self._port.reset_input_buffer()
            self._port.write(request)
            found = self._receive(decoder, answers, patience_s)
        except GONE as error:
            raise PortError(f"{self.name} is gone") from error
        # What comes in two pieces is late, not broken: this program, or the other, was held up.
        self.broken += decoder.sum_errors + (decoder.skipped > rest and not decoder.cut)
        self._late = len(found) < answers
        return found

    def drain(self, silence_s: float) -> None:
        """Take in and forget what still comes, until nothing has come for `silence_s`, or long.

        Raises:
            PortError: the port is gone.
        """
        try:
            began_s = now_s = heard_s = time.monotonic()
            while now_s - heard_s < silence_s and now_s - began_s < _LONGEST_DRAIN * silence_s:
                heard = bool(self._port.read(_CHUNK))
                now_s = time.monotonic()
                heard_s = now_s if heard else heard_s
        except GONE as error:
            raise PortError(f"{self.name} is gone") from error

    def _receive(self, decoder: Decoder, answers: int, patience_s: float) -> list[Status]:
        found: list[Status] = []
        end_s = time.monotonic() + patience_s
        while len(found) < answers:
            # All there is, or else wait for the first byte: to ask for more waits for all of it.
            data = self._port.read(min(max(1, self._port.in_waiting), _CHUNK))
            now_s = time.monotonic()
            for packet in decoder.feed(data, now_s):
                answer = decoder.framing.as_status(packet)
                if answer is not None:
                    found.append(answer)
            if now_s > end_s:
                break
        return found

    def close(self) -> None:
        """Close the port, whatever has become of it."""
        try:
            self._port.close()
        except GONE:
            return
