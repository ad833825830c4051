"""`tsd-foxglove` accepts or refuses headers of any bytes before the socket opens."""

from __future__ import annotations

import asyncio
import logging
import ssl

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tsd_twin.adapters.foxglove.gateway import FOXGLOVE_ORIGIN, Access, Front
from tsd_twin.adapters.foxglove.sdk import LOOPBACK, SUBPROTOCOL

SECRET = "0123456789abcdef01234567"  # noqa: S105
STATUS = {b"Host": 403, b"Origin": 403, b"Authorization": 401, b"Sec-WebSocket-Protocol": 400}


async def answers(requests: list[dict[bytes, bytes]]) -> list[int]:
    """Return the status of each request, with valid headers except for those given."""
    front = Front(Access(SECRET), None, 1, ssl.create_default_context())
    await front.start(LOOPBACK, 0)
    good = {
        b"Host": f"{LOOPBACK}:{front.port}".encode(),
        b"Origin": FOXGLOVE_ORIGIN.encode(),
        b"Authorization": f"Bearer {SECRET}".encode(),
        b"Sec-WebSocket-Protocol": SUBPROTOCOL.encode(),
    }
    found: list[int] = []
    try:
        for changed in requests:
            reader, writer = await asyncio.open_connection(LOOPBACK, front.port)
            lines = [name + b": " + value for name, value in {**good, **changed}.items()]
            writer.write(b"GET / HTTP/1.1\r\n" + b"\r\n".join(lines) + b"\r\n\r\n")
            found.append(int((await reader.readline()).split()[1]))
            writer.close()
            await writer.wait_closed()
    finally:
        await front.stop()
    return found


def test_bytes_that_are_not_utf8_are_refused_without_a_traceback(
    caplog: pytest.LogCaptureFixture,
) -> None:
    values = [b"\xff", b"Bearer \xff\xfe", b"\xc3(", b"http://\x80.example", b"\xed\xa0\x80"]
    cases = [(name, value) for name in STATUS for value in values]
    with caplog.at_level(logging.WARNING):
        found = asyncio.run(answers([{name: value} for name, value in cases]))
    assert found == [STATUS[name] for name, _ in cases]
    assert not [record for record in caplog.records if record.exc_info]


def visible(raw: bytes) -> bytes:
    """Bytes that do not end a header."""
    return bytes(each for each in raw if each > 0x20)


@settings(max_examples=20)
@given(
    st.lists(
        st.tuples(st.sampled_from(sorted(STATUS)), st.binary(min_size=1, max_size=30)),
        min_size=1,
        max_size=20,
    )
)
def test_no_bytes_of_a_header_are_an_internal_error(cases: list[tuple[bytes, bytes]]) -> None:
    found = asyncio.run(answers([{name: b"x" + visible(value)} for name, value in cases]))
    assert set(found) <= {*STATUS.values()}
