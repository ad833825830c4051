"""Random packets, with many bytes that look like a header."""

from __future__ import annotations

from hypothesis import strategies as st

from tsd_twin.hardware.dynamixel.packets import Instruction, Packet

IDS = st.integers(0, 252)
LIKE_HEADERS = st.lists(st.sampled_from(b"\xff\xfd\x00\x01\x55"), max_size=40).map(bytes)
DATA = st.one_of(st.binary(max_size=60), LIKE_HEADERS)
PACKETS = st.builds(Packet, IDS, st.sampled_from([int(i) for i in Instruction]), DATA)
