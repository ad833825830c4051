"""Users without files, and the browser's part of a login."""

from __future__ import annotations

import http.client
from contextlib import closing
from functools import cache
from urllib.parse import urlencode

from tests.support.page_client import PATIENCE_S
from tsd_twin.security import Role
from tsd_twin.security.users import Users

PHRASE = "correct horse battery"


@cache
def users() -> Users:
    """Alice and Bob drive, Guest watches, Eve watches and may stop; they share a password."""
    made = Users({})
    made.put("alice", Role.OPERATOR, PHRASE, may_stop=False)
    made.put("bob", Role.OPERATOR, PHRASE, may_stop=False)
    made.put("guest", Role.VIEWER, PHRASE, may_stop=False)
    made.put("eve", Role.VIEWER, PHRASE, may_stop=True)
    return made


def ask(
    port: int, method: str, path: str, body: str = "", **headers: str
) -> tuple[http.client.HTTPResponse, str]:
    """Send one request as a page of the gateway would; a header's underscore is a dash."""
    fixed = {"Origin": f"http://127.0.0.1:{port}"} if method == "POST" else {}
    fixed |= {"Content-Type": "application/x-www-form-urlencoded"} if body else {}
    fixed |= {name.replace("_", "-"): value for name, value in headers.items()}
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)) as connection:
        connection.request(method, path, body=body or None, headers=fixed)
        answer = connection.getresponse()
        return answer, answer.read().decode()


def log_in(
    port: int, name: str, password: str = PHRASE, **headers: str
) -> tuple[http.client.HTTPResponse, str]:
    """Send the form of the login page."""
    form = urlencode({"name": name, "password": password})
    return ask(port, "POST", "/login", form, **headers)


def cookie_of(port: int, name: str, **headers: str) -> str:
    """Log in, and return the `Cookie` header to send from then on."""
    answer, body = log_in(port, name, **headers)
    assert answer.status == 303, body
    return answer.headers["Set-Cookie"].split(";")[0]
