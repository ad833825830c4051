"""Headers of any bytes are accepted or refused before the socket opens; none is an error of ours."""

from __future__ import annotations

import pytest
from aiohttp import web
from aiohttp.test_utils import make_mocked_request
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.foxglove.front import FOXGLOVE_ORIGIN, Access
from tsd_twin.foxglove.sdk import LOOPBACK, SUBPROTOCOL

PORT = 8765
TOKEN = "0123456789abcdef01234567"
GOOD = {
    "Host": f"{LOOPBACK}:{PORT}",
    "Origin": FOXGLOVE_ORIGIN,
    "Authorization": f"Bearer {TOKEN}",
    "Sec-WebSocket-Protocol": SUBPROTOCOL,
}
STATUS = {"Host": 403, "Origin": 403, "Authorization": 401, "Sec-WebSocket-Protocol": 400}


def refusal(headers: dict[str, str]) -> web.HTTPException | None:
    request = make_mocked_request("GET", "/", headers=headers)
    return Access(TOKEN).refusal(request, LOOPBACK, PORT)


def decoded(raw: bytes) -> str:
    """The text that aiohttp makes of the bytes of a header."""
    return raw.decode("utf-8", "surrogateescape")


def test_a_good_request_is_accepted() -> None:
    assert refusal(GOOD) is None


@pytest.mark.parametrize("name", STATUS)
@pytest.mark.parametrize(
    "raw", [b"\xff", b"Bearer \xff\xfe", b"\xc3(", b"http://\x80.example", b"\xed\xa0\x80"]
)
def test_bytes_that_are_not_utf8_are_refused(name: str, raw: bytes) -> None:
    found = refusal({**GOOD, name: decoded(raw)})
    assert found is not None
    assert found.status == STATUS[name]
    assert found.body


@given(st.sampled_from(sorted(STATUS)), st.binary(min_size=1, max_size=30))
def test_no_bytes_of_a_header_raise(name: str, raw: bytes) -> None:
    found = refusal({**GOOD, name: decoded(raw)})
    assert found is None or found.status in STATUS.values()
