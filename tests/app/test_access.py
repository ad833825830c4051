"""A dashboard for other machines: user accounts, refused requests, and login in a browser."""

from __future__ import annotations

import asyncio
import os
import pty
import re
import ssl
import subprocess
import sys
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect
from websockets.asyncio.client import connect as connect_async
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from tests.app.mistaken_programs import start_each
from tests.support.browser import (
    CHEAP_FLAGS,
    FLAGS_WITHOUT_SCENE,
    PATIENCE_MS,
    executable,
    mode,
    press,
    press_linked,
)
from tests.support.gateway_requests import nginx
from tests.support.programs import Program
from tests.support.withheld import PATIENCE_S
from tsd_twin.security import Role
from tsd_twin.security.users import Users

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(300)]

Start = Callable[..., Program]
PHRASE = "correct horse battery"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of users as `tsd-users` makes it, and a certificate as `tsd-certs` does."""
    made = tmp_path_factory.mktemp("access")
    for flags in (["--operator", "alice"], ["--viewer", "guest"]):
        subprocess.run(
            [sys.executable, "-m", "tsd_users", str(made / "users.toml"), *flags],
            input=f"{PHRASE}\n",
            text=True,
            check=True,
            stdout=subprocess.DEVNULL,
        )
    hosts = ["--robot-host", "localhost", "--robot-host", "robots.example"]
    subprocess.run(
        [sys.executable, "-m", "tsd_certs", str(made / "keys"), *hosts],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    return made


@pytest.fixture
def context(browser: Browser) -> Generator[BrowserContext]:
    made = browser.new_context(
        ignore_https_errors=True,
        viewport={"width": 960, "height": 600},
        device_scale_factor=0.5,  # A user redirected after a login cannot ask for fewer pixels.
    )
    made.set_default_timeout(PATIENCE_MS)
    yield made
    made.close()


def access_flags(folder: Path) -> list[str]:
    keys = folder / "keys"
    return [
        *("--users", str(folder / "users.toml")),
        *("--tls-cert", str(keys / "robot.pem"), "--tls-key", str(keys / "robot.key")),
    ]


@pytest.fixture(scope="module")
def endpoint(start_shared: Start) -> str:
    """A robot for all tests."""
    return start_shared("tsd_mock", "--listen", "tcp/127.0.0.1:0").ready().split()[-1]


def served(start: Start, endpoint: str, *flags: str) -> str:
    """Start a dashboard of the robot; return its address."""
    line = start("tsd_dashboard", "--port", "0", "--connect", endpoint, *flags).ready()
    return re.findall(r"https?://\S+", line)[0]


# Users.


def test_users_come_and_go_and_the_file_says_who_there_is(start: Start, tmp_path: Path) -> None:
    file = tmp_path / "users.toml"
    nobody = start("tsd_users", str(file))
    assert nobody.wait() == 1
    assert "--operator NAME" in nobody.sentence
    for flags in (("--operator", "alice"), ("--viewer", "eve", "--may-stop")):
        program = start("tsd_users", str(file), *flags)
        assert program.process.stdin is not None
        program.process.stdin.write(f"{PHRASE}\n")
        program.process.stdin.flush()
        assert program.wait() == 0
    assert program.output == ["operator alice, may stop", "viewer eve, may stop"]
    assert start("tsd_users", str(file), "--remove", "alice").wait() == 0
    assert Users.load(file).names == ["eve"]
    assert Users.load(file).user("eve").role is Role.VIEWER


def test_a_password_at_the_terminal_is_asked_for_twice_and_not_echoed(tmp_path: Path) -> None:
    file = tmp_path / "users.toml"
    terminal, its_side = pty.openpty()
    program = subprocess.Popen(
        [sys.executable, "-m", "tsd_users", str(file), "--operator", "al"],
        stdin=its_side,
        stdout=its_side,
        stderr=its_side,
        start_new_session=True,
    )
    os.close(its_side)
    seen = b""
    for prompt in (b"new password for al: ", b"the same again: "):
        while prompt not in seen:
            seen += os.read(terminal, 1024)
        os.write(terminal, f"{PHRASE}\n".encode())
    while b"operator al" not in seen:
        seen += os.read(terminal, 1024)
    assert program.wait(PATIENCE_S) == 0
    os.close(terminal)
    assert PHRASE.encode() not in seen
    assert Users.load(file).check("al", PHRASE) is not None


# Refusals.


REFUSALS = [
    (["--host", "0.0.0.0"], "--users FILE"),
    (["--host", "0.0.0.0", "--users", "{users}"], "--tls-cert"),
    (["--host", "0.0.0.0", "--users", "{users}", "--behind-proxy"], "passwords"),
    (["--behind-proxy"], "--users FILE"),
    (["--tls-cert", "{pem}"], "go together"),
    (["--tls-cert", "{pem}", "--tls-key", "{other}"], "is not the key of"),
    (["--tls-cert", "{pem}", "--tls-key", "nowhere.key"], "nowhere.key cannot be read"),
    (["--tls-cert", "{users}", "--tls-key", "{other}"], "as a certificate"),
    (["--users", "nowhere.toml"], "nowhere.toml cannot be read"),
    (["--users", "{open}"], "chmod 600"),
]
"""Flags, and words of the sentence that refuses them."""


def test_what_would_be_open_or_cannot_work_is_one_sentence(folder: Path, tmp_path: Path) -> None:
    readable = tmp_path / "users.toml"
    readable.write_bytes((folder / "users.toml").read_bytes())
    readable.chmod(0o644)
    places = {
        "users": folder / "users.toml",
        "pem": folder / "keys" / "robot.pem",
        "other": folder / "keys" / "ca.key",
        "open": readable,
    }
    mistakes = [["--port", "0", *(each.format(**places) for each in row)] for row, _ in REFUSALS]
    refused = start_each("tsd_dashboard", mistakes, tmp_path)
    for (flags, sentence), ended in zip(REFUSALS, refused, strict=True):
        assert ended.code == 1, flags
        assert sentence in ended.said, flags
        assert len(ended.said.splitlines()) == 1, flags


def test_users_beside_an_open_bus_are_warned_of_before_it_is_ready(
    start: Start, folder: Path, endpoint: str
) -> None:
    flags = ("--port", "0", "--connect", endpoint)
    guarded = start("tsd_dashboard", *flags, "--users", str(folder / "users.toml"))
    guarded.ready()
    plain = start("tsd_dashboard", *flags)
    plain.ready()
    assert guarded.end() == plain.end() == 0
    (warning,) = [line for line in guarded.errors if "WARNING" in line]
    assert f"The bus at {endpoint} has no certificates" in warning
    assert "without a password" in warning
    assert plain.errors == []


# In a browser.


def log_in(page: Page, name: str, phrase: str = PHRASE) -> None:
    page.get_by_label("Name").fill(name)
    page.get_by_label("Password").fill(phrase)
    page.get_by_role("button", name="Log in").click()


@pytest.mark.parametrize("browser", [FLAGS_WITHOUT_SCENE], indirect=True, ids=["no scene"])
def test_alice_logs_in_drives_under_her_name_and_logs_out(
    start: Start, folder: Path, endpoint: str, context: BrowserContext
) -> None:
    url = served(start, endpoint, "--host", "0.0.0.0", *access_flags(folder))
    url = url.replace("0.0.0.0", "localhost")
    page = context.new_page()
    page.goto(url)
    expect(page.get_by_label("Name")).to_be_focused()
    log_in(page, "alice", "wrong wrong wrong")
    expect(page.get_by_role("alert")).to_have_text("Name or password is wrong.")
    expect(page.get_by_label("Password")).to_be_focused()
    assert context.cookies() == []
    log_in(page, "Alice ")
    page.wait_for_url(url)
    (cookie,) = context.cookies()
    assert cookie.get("secure")
    assert cookie.get("httpOnly")
    assert cookie.get("sameSite") == "Strict"
    page.goto(url)
    press_linked(page, "Take control", page.get_by_role("button", name="Release control"))
    press(page, "Keys and settings")
    page.get_by_role("button", name="Your name: alice").last.click()
    press(page, "Log out")
    page.wait_for_url("**/login")
    assert context.cookies() == []
    page.goto(url)
    expect(page.get_by_role("button", name="Log in")).to_be_visible()


def test_a_viewer_in_a_browser_has_nothing_to_drive_with_and_goes_when_logged_out(
    start: Start, folder: Path, endpoint: str, context: BrowserContext
) -> None:
    url = served(start, endpoint, *access_flags(folder))
    page = context.new_page()
    page.goto(url)
    log_in(page, "guest")
    mode(page, "disarmed")
    expect(page.get_by_text("You may look, not drive").first).to_be_visible()
    for name in ("Take control", "Arm"):
        expect(page.get_by_role("button", name=name, exact=True)).to_be_hidden()
    stop = page.get_by_role("button", name="STOP", exact=True)
    expect(stop).to_have_attribute("aria-disabled", "true")
    expect(page.get_by_role("application")).to_have_attribute("aria-disabled", "true")
    # The login ends in another tab; the page notices and does not pretend to be live.
    page.evaluate("fetch('logout', { method: 'POST', redirect: 'manual' })")
    page.wait_for_url("**/login")


async def answer(host: str, port: int, headers: dict[str, str], trusting: ssl.SSLContext) -> int:
    """Return the status with which the page's websocket answers, 101 if it opens."""
    # Not the client of `websockets.sync`: see `test_other_machines_need_a_token_and_tls`.
    try:
        async with connect_async(
            f"wss://{host}/twin/teleop?page=0123456789abcdef",
            host="127.0.0.1",
            port=port,
            additional_headers=headers,
            ssl=trusting,
            open_timeout=PATIENCE_S,
        ):
            return 101
    except InvalidStatus as refused:
        return refused.response.status_code


def test_nginx_as_on_the_page_of_the_docs(
    start: Start, folder: Path, endpoint: str, context: BrowserContext, tmp_path: Path
) -> None:
    with nginx(tmp_path, folder / "keys") as proxy:
        host = f"robots.example:{proxy.port}"
        flags = ("--users", str(folder / "users.toml"), "--behind-proxy", "--allow-host", host)
        url = served(start, endpoint, *flags)
        proxy.pass_on_to(url)
        page = context.new_page()
        page.goto(f"https://localhost:{proxy.port}/twin/")
        expect(page.get_by_text("does not answer to the name")).to_be_visible()
        there = f"https://{host}/twin"
        resolved = context.browser
        assert resolved is not None
        by_name = resolved.browser_type.launch(
            executable_path=executable(),
            args=[*CHEAP_FLAGS, "--host-resolver-rules=MAP robots.example 127.0.0.1"],
        )
        outside = by_name.new_context(ignore_https_errors=True, device_scale_factor=0.5)
        outside.set_default_timeout(PATIENCE_MS)
        page = outside.new_page()
        page.goto(there)
        assert page.url == f"{there}/login"
        log_in(page, "alice")
        expect(page).to_have_url(f"{there}/", timeout=PATIENCE_MS)
        (cookie,) = outside.cookies()
        assert (cookie.get("path"), cookie.get("secure")) == ("/twin", True)
        page.goto(f"{there}/")
        press_linked(page, "Take control", page.get_by_role("button", name="Release control"))
        expect(page.locator(".viewport-frame[data-ready]")).to_be_visible(timeout=PATIENCE_MS)
        value = f"{cookie.get('name')}={cookie.get('value')}"
        trusting = ssl.create_default_context(cafile=folder / "keys" / "ca.pem")
        for origin, allowed in ((f"https://{host}", True), ("https://evil.example", False)):
            headers = {"Cookie": value, "Origin": origin}
            # On a thread, because Playwright uses the event loop of this one.
            with ThreadPoolExecutor(1) as pool:
                asked = answer(host, proxy.port, headers, trusting)
                status = pool.submit(asyncio.run, asked).result()
            assert (status == 101) is allowed, (origin, status)
        press(page, "Keys and settings")
        page.get_by_role("button", name="Your name: alice").last.click()
        press(page, "Log out")
        page.wait_for_url("**/twin/login")
        by_name.close()
    with pytest.raises(InvalidStatus):  # Bypassing the proxy grants no access.
        connect(url.replace("http", "ws") + "teleop?page=0123456789abcdef")
