"""Logging in and out: a page that needs no script, and what it sends."""

from __future__ import annotations

import asyncio
import html
import math
import time
from base64 import b64encode
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from pathlib import Path

from aiohttp import web

from tsd_twin.access import User
from tsd_twin.dashboard.door import Door, approach_of, visitor_of
from tsd_twin.dashboard.form import FormError, name_and_password
from tsd_twin.dashboard.guard import HEADERS
from tsd_twin.dashboard.pages import STATIC

_FOLDER = Path(__file__).parent
_AT_ONCE = 8
"""Passwords that wait to be checked, one at a time: each takes 64 MiB and a processor's time."""
_TOO_MANY = "Too many wrong passwords"
_HOME = "./"
"""Relative to `login` and `logout`: whoever is in front may have a prefix."""


class Reception:
    """The login page and the buttons that lead in and out."""

    def __init__(self, door: Door) -> None:
        self._door = door
        self._template = (_FOLDER / "login.html").read_text(encoding="utf-8")
        styles = STATIC / "colours.css", _FOLDER / "login.css"
        self._style = "\n".join(style.read_text(encoding="utf-8") for style in styles)
        digest = b64encode(sha256(self._style.encode()).digest()).decode()
        self._headers = HEADERS | {
            "Content-Security-Policy": (
                f"default-src 'none'; style-src 'sha256-{digest}'; form-action 'self'; "
                "base-uri 'none'; frame-ancestors 'none'"
            ),
            # With no-referrer a browser would send `Origin: null` with the form.
            "Referrer-Policy": "same-origin",
            "Cache-Control": "no-store",
        }
        # Beside the loop that is between fingers and robots, and never two at once.
        self._checks = ThreadPoolExecutor(1, "passwords")
        self._checking = 0

    def add_to(self, router: web.UrlDispatcher) -> None:
        """Answer `login` and `logout`."""
        router.add_get("/login", self._show)
        router.add_post("/login", self._log_in)
        router.add_post("/logout", self._log_out)

    def close(self) -> None:
        """Check no more passwords."""
        self._checks.shutdown(wait=False, cancel_futures=True)

    async def _show(self, request: web.Request) -> web.StreamResponse:
        if self._door.visitor(request) is not None:
            raise web.HTTPSeeOther(_HOME)
        return self._page()

    async def _log_in(self, request: web.Request) -> web.StreamResponse:
        _need_origin(request)
        users = self._door.rules.users
        if users is None:
            raise web.HTTPSeeOther(_HOME)
        address = approach_of(request).address
        try:
            name, password = await name_and_password(request)
        except FormError as error:
            wait_s = self._door.logins.wait_nameless_s(address, time.monotonic())
            return self._last(
                self._page(_TOO_MANY, wait_s=wait_s)
                if wait_s
                else self._page(str(error), status=400)
            )
        except TimeoutError:
            return self._last(self._page("The form took too long to come.", status=408))
        # A phone may write names with a capital and a space after them.
        name = name.strip().lower()[:64]
        if self._checking >= _AT_ONCE:
            return self._page("Too many people try to log in at once", name, wait_s=1.0)
        wait_s = self._door.logins.wait_s(address, name, time.monotonic())
        if wait_s > 0.0:
            return self._page(_TOO_MANY, name, wait_s=wait_s)
        user = await self._check(name, password)
        if user is None:
            return self._page("Name or password is wrong.", name, status=401)
        self._door.logins.right(address, name)
        return await self._let_in(request, user)

    async def _check(self, name: str, password: str) -> User | None:
        users = self._door.rules.users
        if users is None:
            return None
        self._checking += 1
        try:
            loop = asyncio.get_running_loop()
            return await loop.run_in_executor(self._checks, users.check, name, password)
        finally:
            self._checking -= 1

    async def _let_in(self, request: web.Request, user: User) -> web.StreamResponse:
        before = self._door.visitor(request)
        if before is not None and before.key is not None:
            await self._door.end(before.key)
        came = approach_of(request)
        response = web.Response(status=303, headers={"Location": _HOME})
        response.set_cookie(
            self._door.cookie,
            self._door.logins.open(user, time.monotonic()),
            path=came.path,
            secure=came.secure,
            httponly=True,
            samesite="Strict",
        )
        return response

    async def _log_out(self, request: web.Request) -> web.StreamResponse:
        _need_origin(request)
        key = visitor_of(request).key
        if key is not None:
            await self._door.end(key)
        response = web.Response(status=303, headers={"Location": "login"})
        response.del_cookie(self._door.cookie, path=approach_of(request).path)
        return response

    def _last(self, response: web.Response) -> web.Response:
        """Return an answer after which the connection ends: the rest of the body is not read."""
        response.force_close()
        return response

    def _page(
        self, problem: str = "", name: str = "", *, status: int = 200, wait_s: float = 0.0
    ) -> web.Response:
        headers = dict(self._headers)
        if wait_s > 0.0:
            whole_s = math.ceil(wait_s)
            status, problem = 429, f"{problem}: wait {_duration(whole_s)} and try again."
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


def _need_origin(request: web.Request) -> None:
    """Refuse a form that does not say where it comes from; the door has refused foreign ones."""
    if "Origin" not in request.headers:
        raise web.HTTPForbidden(text="A form says where it comes from: send Origin.")


def _duration(whole_s: int) -> str:
    return f"{whole_s} s" if whole_s < 100 else f"{math.ceil(whole_s / 60)} min"
