"""Port of the manufacturer's SDK with bytes on both sides instead of a serial line."""

from __future__ import annotations


class BytesPort:
    """Port that stores the bytes the SDK writes, and supplies those it reads."""

    def __init__(self, answer: bytes = b"") -> None:
        self.is_using = False
        self.written = b""
        self._answer = answer

    def clearPort(self) -> None:  # noqa: N802  The SDK's name.
        """Do nothing: there are no old bytes."""

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        self.written += bytes(packet)
        return len(packet)

    def readPort(self, length: int) -> bytes:  # noqa: N802
        taken, self._answer = self._answer[:length], self._answer[length:]
        return taken

    def setPacketTimeout(self, length: int) -> None:  # noqa: N802
        """Do nothing: there are no time-outs."""

    def isPacketTimeout(self) -> bool:  # noqa: N802
        return not self._answer
