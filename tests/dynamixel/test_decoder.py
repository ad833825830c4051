"""Packets from a stream: in pieces, amid garbage, truncated; the buffer is bounded."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.dynamixel.packet_strategies import PACKETS
from tsd_twin.hardware.dynamixel.packets import Decoder, Packet, protocol1, protocol2

PROTOCOLS = pytest.mark.parametrize("protocol", [protocol1, protocol2])
PING = Packet(200, 1)


def chunks(stream: bytes, cuts: list[int]) -> list[bytes]:
    places = sorted({0, len(stream), *(cut % (len(stream) + 1) for cut in cuts)})
    return [stream[a:b] for a, b in itertools.pairwise(places)]


@PROTOCOLS
@given(st.lists(PACKETS, max_size=5), st.lists(st.integers(0, 1000), max_size=12))
def test_however_a_stream_is_cut_its_packets_come_out(
    protocol: type, packets: list[Packet], cuts: list[int]
) -> None:
    decoder = Decoder(protocol)
    stream = b"".join(protocol.encode(packet) for packet in packets)
    found = [p for part in chunks(stream, cuts) for p in decoder.feed(part, 0.0)]
    assert found == packets
    assert (decoder.sum_errors, decoder.cut, decoder.skipped) == (0, 0, 0)


@PROTOCOLS
@given(PACKETS)
def test_byte_by_byte_the_packet_is_there_with_its_last(protocol: type, packet: Packet) -> None:
    decoder = Decoder(protocol)
    *most, last = (bytes([byte]) for byte in protocol.encode(packet))
    assert not [p for byte in most for p in decoder.feed(byte, 0.0)]
    assert decoder.feed(last, 0.0) == [packet]


@PROTOCOLS
@given(st.binary(max_size=600), st.lists(st.integers(0, 1000), max_size=6))
def test_after_any_garbage_and_a_pause_a_packet_is_understood(
    protocol: type, garbage: bytes, cuts: list[int]
) -> None:
    decoder = Decoder(protocol, longest=160)
    for part in chunks(garbage, cuts):
        decoder.feed(part, 0.0)
        assert len(decoder.rest) <= 160
    decoder.feed(b"", 0.021)
    assert not decoder.rest
    assert decoder.feed(protocol.encode(PING), 0.022) == [PING]


@PROTOCOLS
@given(PACKETS, st.lists(PACKETS, min_size=1, max_size=3), st.data())
def test_a_packet_that_is_cut_takes_none_with_it(
    protocol: type, first: Packet, others: list[Packet], data: st.DataObject
) -> None:
    """At the latest when the line falls silent; a truncated length may cover what follows."""
    decoder = Decoder(protocol)
    frame = protocol.encode(first)
    cut = frame[: data.draw(st.integers(0, len(frame) - 1))]
    sent = cut + b"".join(protocol.encode(packet) for packet in others)
    # One in 256 truncated packets is completed by following bytes with a valid checksum.
    size = protocol.size(sent[:12])
    assume(not cut or not size or protocol.decode(sent[:size]) is None)
    found = decoder.feed(sent, 0.0)
    found += decoder.feed(b"", 0.03)
    assert [p for p in found if p in others][-len(others) :] == others


@PROTOCOLS
def test_a_frame_longer_than_allowed_is_never_waited_for(protocol: type) -> None:
    decoder = Decoder(protocol, longest=100)
    long = protocol.encode(Packet(1, 3, bytes(120)))
    assert decoder.feed(long[:50], 0.0) == []
    assert decoder.feed(protocol.encode(PING), 0.0) == [PING]


def test_what_goes_wrong_is_counted() -> None:
    decoder = Decoder(protocol2)
    frame = protocol2.encode(PING)
    assert decoder.feed(b"noise" + frame[:-1] + b"?", 0.0) == []
    assert (decoder.sum_errors, decoder.cut, decoder.skipped) == (1, 0, 15)
    assert decoder.feed(frame[:8], 1.0) == []
    assert decoder.feed(frame, 1.1) == [PING]
    assert (decoder.sum_errors, decoder.cut, decoder.skipped) == (1, 1, 23)


def test_within_the_time_a_packet_may_come_in_pieces() -> None:
    decoder = Decoder(protocol2, timeout_s=0.02)
    frame = protocol2.encode(PING)
    found = [p for i, byte in enumerate(frame) for p in decoder.feed(bytes([byte]), 0.019 * i)]
    assert found == [PING]
