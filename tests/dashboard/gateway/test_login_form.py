"""Only one form in one encoding logs in; all else is refused with a sentence and counted."""

from __future__ import annotations

from collections.abc import Generator
from urllib.parse import urlencode

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.gateway_requests import (
    FORM,
    MALFORMED,
    answer,
    ask,
    limiting,
    log_in,
    malformed,
    request,
    users,
)
from tests.support.page_client import Site, site
from tsd_twin.dashboard.gateway.auth import AccessSettings, AuthMiddleware
from tsd_twin.dashboard.gateway.login import LoginFormError, parse_login_form


@pytest.fixture
def fresh() -> Generator[Site]:
    with site(auth=AuthMiddleware(AccessSettings(users=users()))) as made:
        yield made


@given(st.text(max_size=80), st.text(max_size=80))
def test_what_a_browser_sends_is_what_was_typed(name: str, password: str) -> None:
    typed = {"name": name, "password": password}
    assert parse_login_form(urlencode(typed).encode()) == (name, password)
    assert parse_login_form(urlencode(dict(reversed(typed.items()))).encode()) == (name, password)


@given(st.binary(max_size=200))
def test_bytes_are_the_form_or_refused(body: bytes) -> None:
    try:
        name, password = parse_login_form(body)
    except LoginFormError:
        return
    assert b"name" in body
    assert b"password" in body
    (name + password).encode()


@given(
    st.lists(
        st.tuples(st.sampled_from(["name", "password", "role", ""]), st.text(max_size=4)),
        max_size=4,
    )
)
def test_each_field_comes_once_and_there_is_no_other(fields: list[tuple[str, str]]) -> None:
    if sorted(key for key, _ in fields) == ["name", "password"]:
        assert dict(fields) == dict(
            zip(("name", "password"), parse_login_form(urlencode(fields).encode()), strict=True)
        )
    else:
        with pytest.raises(LoginFormError):
            parse_login_form(urlencode(fields).encode())


def test_malformed_bodies_are_400_without_a_traceback(caplog: pytest.LogCaptureFixture) -> None:
    with site(auth=limiting(free=1000, first_s=5.0)) as fresh:
        for what, kind, body in MALFORMED:
            assert answer(fresh.port, malformed(fresh.port, kind, body)) == 400, what
        gzip = f"Content-Type: {FORM}", "Content-Encoding: gzip"
        zipped = request(fresh.port, "POST", "/login", *gzip, body=b"x")
        assert answer(fresh.port, zipped) == 400
        broken = request(fresh.port, "POST", "/login", f"Content-Type: {FORM}").replace(
            b"Content-Length: 0", b"Transfer-Encoding: chunked"
        )
        assert answer(fresh.port, broken + b"zz\r\nname\r\n") == 400
        assert answer(fresh.port, b"GET / HTTP/1.1\r\nHo st: x\r\n\r\n") == 400
        assert caplog.records == []
        assert log_in(fresh.port, "alice")[0].status == 303


def test_malformed_bodies_count_as_wrong_passwords_of_their_address() -> None:
    with site(auth=limiting(free=5, first_s=500.0)) as fresh:
        for _ in range(5):
            assert ask(fresh.port, "POST", "/login", "name")[0].status == 400
        for body in ("name", "name=alice&password=x"):
            refused, page = ask(fresh.port, "POST", "/login", body)
            assert refused.status == 429
            assert "Too many wrong passwords: wait 9 min" in page
