"""Random packets, with many bytes that look like a header."""

from __future__ import annotations

from hypothesis import strategies as st

from tsd_twin.hardware.dynamixel.packets import Instruction, Packet

IDS = st.integers(0, 252)
LIKE_HEADERS = st.lists(st.sampled_from(b"\xff\xfd\x00\x01\x55"), max_size=40).map(bytes)
DATA = st.one_of(st.binary(max_size=60), LIKE_HEADERS)
PACKETS = st.builds(Packet, IDS, st.sampled_from([int(i) for i in Instruction]), DATA)


class BytesPort:
    """Port that stores the bytes the SDK writes, and supplies those it reads."""

    def __init__(self, answer: bytes = b"") -> None:
        self.is_using = False
        self.written = b""
        self._answer = answer

    def clearPort(self) -> None:  # noqa: N802  The SDK's name.
        """Do nothing, because there are no old bytes."""

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        self.written += bytes(packet)
        return len(packet)

    def readPort(self, length: int) -> bytes:  # noqa: N802
        taken, self._answer = self._answer[:length], self._answer[length:]
        return taken

    def setPacketTimeout(self, length: int) -> None:  # noqa: N802
        """Do nothing, because there are no timeouts."""

    def isPacketTimeout(self) -> bool:  # noqa: N802
        return not self._answer
