"""Login page of the dashboard, its routes and the strict parser of its form."""

from __future__ import annotations

import asyncio
import html
import math
from base64 import b64encode
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from pathlib import Path
from urllib.parse import parse_qsl

from aiohttp import web

from tsd_twin.dashboard.gateway.auth import (
    CLIENT_ADDRESS,
    HEADERS,
    PRINCIPAL,
    AuthMiddleware,
    require_origin,
)
from tsd_twin.security.users import User, Users

_TYPE = "application/x-www-form-urlencoded"
_FIELDS = ("name", "password")
READ_S = 10.0
"""Timeout for reading a login form."""


class LoginFormError(Exception):
    """Invalid body of a login form; the message is one sentence."""


async def name_and_password(request: web.Request) -> tuple[str, str]:
    """Return name and password from the form of a request.

    Raises:
        LoginFormError: If the body is not this form, has other fields, or is not UTF-8.
        TimeoutError: If the form does not arrive within `READ_S`.
    """
    kind, _, parameters = request.headers.get("Content-Type", "").lower().partition(";")
    charset = parameters.strip().replace('"', "")
    if kind.strip() != _TYPE or charset not in ("", "charset=utf-8"):
        raise LoginFormError(f"A login is sent as {_TYPE} in UTF-8.")
    if "Content-Encoding" in request.headers:
        raise LoginFormError("A login is not sent compressed.")
    try:
        async with asyncio.timeout(READ_S):
            body = await request.read()
    except web.HTTPRequestEntityTooLarge:
        raise LoginFormError("This is longer than any login.") from None
    except web.RequestPayloadError:
        raise LoginFormError("This is not the form of the login page.") from None
    return parse_login_form(body)


def parse_login_form(body: bytes) -> tuple[str, str]:
    """Parse the name and password of a form.

    Raises:
        LoginFormError: If a field is missing, unknown or repeated, or the body is not UTF-8.
    """
    try:
        pairs = parse_qsl(
            body.decode("utf-8"),
            keep_blank_values=True,
            strict_parsing=True,
            errors="strict",
            max_num_fields=len(_FIELDS),
        )
    except ValueError:  # Includes UnicodeError.
        raise LoginFormError("This is not the form of the login page.") from None
    if sorted(key for key, _ in pairs) != list(_FIELDS):
        raise LoginFormError("A login has a name and a password, and nothing else.")
    fields = dict(pairs)
    return fields["name"], fields["password"]


_TEMPLATES = Path(__file__).parent
_MAX_PENDING_LOGINS = 8
"""Maximum number of passwords in the queue; checking one takes 64 MiB and a CPU core."""
_TOO_MANY = "Too many wrong passwords"
_HOME = "./"
"""Relative to `login` and `logout`, because a proxy may add a prefix."""


class LoginRoutes:
    """Routes of the login page, login and logout."""

    def __init__(self, auth: AuthMiddleware) -> None:
        self._auth = auth
        self._template = (_TEMPLATES / "login.html").read_text(encoding="utf-8")
        self._style = (_TEMPLATES / "login.css").read_text(encoding="utf-8")
        digest = b64encode(sha256(self._style.encode()).digest()).decode()
        self._headers = HEADERS | {
            "Content-Security-Policy": (
                f"default-src 'none'; style-src 'sha256-{digest}'; form-action 'self'; "
                "base-uri 'none'; frame-ancestors 'none'"
            ),
            # With no-referrer, browsers would send `Origin: null` with the form.
            "Referrer-Policy": "same-origin",
            "Cache-Control": "no-store",
        }
        # Check one password at a time on a separate thread, because the event loop forwards
        # commands.
        self._password_pool = ThreadPoolExecutor(1, "passwords")
        self._pending_checks = 0

    def add_to(self, router: web.UrlDispatcher) -> None:
        """Register the routes of `login` and `logout`."""
        router.add_get("/login", self._show)
        router.add_post("/login", self._log_in)
        router.add_post("/logout", self._log_out)

    def close(self) -> None:
        """Shut down the password thread."""
        self._password_pool.shutdown(wait=False, cancel_futures=True)

    async def _show(self, request: web.Request) -> web.StreamResponse:
        if self._auth.principal_of_request(request) is not None:
            raise web.HTTPSeeOther(_HOME)
        return self._page()

    async def _log_in(self, request: web.Request) -> web.StreamResponse:
        require_origin(request)
        users = self._auth.rules.users
        if users is None:
            raise web.HTTPSeeOther(_HOME)
        address = request[CLIENT_ADDRESS].address
        try:
            name, password = await name_and_password(request)
        except LoginFormError as error:
            wait_s = self._auth.logins.wait_nameless_s(address, self._auth.now_s())
            return self._last(
                self._page(_TOO_MANY, wait_s=wait_s)
                if wait_s
                else self._page(str(error), status=400)
            )
        except TimeoutError:
            return self._last(self._page("The form took too long to come.", status=408))
        # Phones may capitalise names and append a space.
        name = name.strip().lower()[:64]
        if self._pending_checks >= _MAX_PENDING_LOGINS:
            return self._page("Too many people try to log in at once", name, wait_s=1.0)
        wait_s = self._auth.logins.wait_s(address, name, self._auth.now_s())
        if wait_s > 0.0:
            return self._page(_TOO_MANY, name, wait_s=wait_s)
        user = await self._check(users, name, password)
        if user is None:
            return self._page("Name or password is wrong.", name, status=401)
        self._auth.logins.right(address, name)
        return await self._start_session(request, user)

    async def _check(self, users: Users, name: str, password: str) -> User | None:
        self._pending_checks += 1
        try:
            loop = asyncio.get_running_loop()
            return await loop.run_in_executor(self._password_pool, users.check, name, password)
        finally:
            self._pending_checks -= 1

    async def _start_session(self, request: web.Request, user: User) -> web.StreamResponse:
        before = self._auth.principal_of_request(request)
        if before is not None and before.key is not None:
            await self._auth.end_login(before.key)
        client = request[CLIENT_ADDRESS]
        response = web.Response(status=303, headers={"Location": _HOME})
        response.set_cookie(
            self._auth.cookie,
            self._auth.logins.open(user, self._auth.now_s()),
            path=client.path,
            secure=client.secure,
            httponly=True,
            samesite="Strict",
        )
        return response

    async def _log_out(self, request: web.Request) -> web.StreamResponse:
        require_origin(request)
        key = request[PRINCIPAL].key
        if key is not None:
            await self._auth.end_login(key)
        response = web.Response(status=303, headers={"Location": "login"})
        response.del_cookie(self._auth.cookie, path=request[CLIENT_ADDRESS].path)
        return response

    def _last(self, response: web.Response) -> web.Response:
        """Return a response that closes the connection without reading the rest of the body."""
        response.force_close()
        return response

    def _page(
        self, problem: str = "", name: str = "", *, status: int = 200, wait_s: float = 0.0
    ) -> web.Response:
        headers = dict(self._headers)
        if wait_s > 0.0:
            whole_s = math.ceil(wait_s)
            wait = f"{whole_s} s" if whole_s < 100 else f"{math.ceil(whole_s / 60)} min"
            status, problem = 429, f"{problem}: wait {wait} and try again."
            headers["Retry-After"] = str(whole_s)
        text = self._template
        for key, value in {
            "style": self._style,
            "name": html.escape(name),
            "problem": html.escape(problem),
            "invalid": "true" if problem else "false",
            "name_focus": "" if name else "autofocus",
            "password_focus": "autofocus" if name else "",
        }.items():
            text = text.replace(f"{{{{{key}}}}}", value)
        return web.Response(text=text, status=status, content_type="text/html", headers=headers)
