"""What the login page sends, read strictly."""

from __future__ import annotations

import asyncio
from urllib.parse import parse_qsl

from aiohttp import web

_TYPE = "application/x-www-form-urlencoded"
_FIELDS = ("name", "password")
READ_S = 10.0
"""How long a form may take to come."""


class FormError(Exception):
    """A body that no login page sends; its text is one sentence."""


async def name_and_password(request: web.Request) -> tuple[str, str]:
    """Return both fields of the form.

    Raises:
        FormError: this is not the form, it has other fields, or is not in UTF-8.
        TimeoutError: it did not come within `READ_S`.
    """
    kind, _, parameters = request.headers.get("Content-Type", "").lower().partition(";")
    charset = parameters.strip().replace('"', "")
    if kind.strip() != _TYPE or charset not in ("", "charset=utf-8"):
        raise FormError(f"A login is sent as {_TYPE} in UTF-8.")
    if "Content-Encoding" in request.headers:
        raise FormError("A login is not sent compressed.")
    try:
        async with asyncio.timeout(READ_S):
            body = await request.read()
    except web.HTTPRequestEntityTooLarge:
        raise FormError("This is longer than any login.") from None
    except web.RequestPayloadError:
        raise FormError("This is not the form of the login page.") from None
    return parse(body)


def parse(body: bytes) -> tuple[str, str]:
    """Return name and password of a form.

    Raises:
        FormError: it has other fields, one of them twice, or is not in UTF-8.
    """
    try:
        pairs = parse_qsl(
            body.decode("utf-8"),
            keep_blank_values=True,
            strict_parsing=True,
            errors="strict",
            max_num_fields=len(_FIELDS),
        )
    except ValueError:  # UnicodeError is one.
        raise FormError("This is not the form of the login page.") from None
    if sorted(key for key, _ in pairs) != list(_FIELDS):
        raise FormError("A login has a name and a password, and nothing else.")
    fields = dict(pairs)
    return fields["name"], fields["password"]
