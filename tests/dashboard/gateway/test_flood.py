"""A page that floods is disconnected; other pages drive and stop undisturbed."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Generator
from itertools import pairwise

import pytest
from websockets.exceptions import InvalidStatus
from websockets.frames import Frame, Opcode

from tests.dashboard.recorders import CommandRecorder, settle, zeros_at_the_end
from tests.support.gateway_requests import cookie_of, users
from tests.support.page_client import Page, Site, robot_on_a_bus, site
from tests.support.withheld import PATIENCE_S, Stopwatch
from tsd_twin.bus import Bus, client_config
from tsd_twin.dashboard.gateway.auth import AccessSettings, AuthMiddleware
from tsd_twin.dashboard.gateway.socket_limits import GRACE, POLICY_VIOLATION, TELEOP, TOO_MUCH
from tsd_twin.dashboard.scene.client_views import BackgroundWorker
from tsd_twin.dashboard.sessions.teleop import ZERO_REPEATS
from tsd_twin.messages.commands import Command

RELEASES = 5
TOO_MANY = round((1.0 + GRACE) * TELEOP.messages.burst) + 100
FLOOD = '{"t":"clear_plan"}'
STOP_S = 0.5
"""Limit in one process with ten flooding threads; `make attack` measures between processes."""


@pytest.fixture(scope="module")
def served() -> Generator[Site]:
    with site() as made:
        yield made


@pytest.fixture
def guarded() -> Generator[Site]:
    with site(auth=AuthMiddleware(AccessSettings(users=users()))) as made:
        yield made


def at_once(page: Page, *texts: str | bytes) -> None:
    """Send messages so that they arrive together."""
    opcodes = [Opcode.TEXT if isinstance(text, str) else Opcode.PING for text in texts]
    data = [text.encode() if isinstance(text, str) else text for text in texts]
    frames = [Frame(*each).serialize(mask=True) for each in zip(opcodes, data, strict=True)]
    page.send_together(b"".join(frames))


@pytest.mark.parametrize(
    "text", [FLOOD, "[" * 30, '{"t":"heartbeat","status_seq":0,"sent_ms":1}', b"ping"]
)
def test_a_page_that_floods_is_cut_off_and_stays_out_for_a_while(
    guarded: Site, text: str | bytes
) -> None:
    guest, alice = cookie_of(guarded.port, "guest"), cookie_of(guarded.port, "alice")
    with guarded.page("00000000000000aa", user="guest", cookie=guest) as page:
        page.until(lambda: page.state)
        at_once(page, *[text] * TOO_MANY)
        assert page.until(lambda: page.closed) == POLICY_VIOLATION
        assert page.close_reason == TOO_MUCH
        with pytest.raises(InvalidStatus) as refused:
            Page(guarded.port, "00000000000000ab", cookie=guest)
        assert refused.value.response.status_code == 429
        assert int(refused.value.response.headers["Retry-After"]) >= 1
    with guarded.page("00000000000000ac", user="alice", cookie=alice) as page:
        page.make_ready()


def test_a_flood_of_fragments_that_never_become_a_message_is_cut_off(guarded: Site) -> None:
    """Empty fragments never exceed the message size, and per-message limits never see them."""
    guest = cookie_of(guarded.port, "guest")
    with guarded.page("00000000000000aa", user="guest", cookie=guest) as page:
        page.until(lambda: page.state)
        page.send_together(Frame(Opcode.TEXT, b"", fin=False).serialize(mask=True))
        fragments = Frame(Opcode.CONT, b"", fin=False).serialize(mask=True) * 1000
        for _ in range(2 + int(TELEOP.on_the_wire.burst / len(fragments))):
            with contextlib.suppress(OSError):
                page.send_together(fragments)
        page.until(lambda: page.closed is not None)
        with pytest.raises(InvalidStatus) as refused:
            Page(guarded.port, "00000000000000ab", cookie=guest)
        assert refused.value.response.status_code == 429


@pytest.mark.busy
def test_while_viewers_flood_an_operator_drives_and_another_stops(guarded: Site) -> None:
    cookies = [cookie_of(guarded.port, "guest") for _ in range(4)]
    ended = threading.Event()

    def flood(number: int) -> None:
        while not ended.wait(0.01):
            try:
                with guarded.page(f"{number:016x}", user="guest", cookie=cookies[number]) as page:
                    while not ended.is_set():
                        at_once(page, *[FLOOD] * 100)
            except (OSError, InvalidStatus):
                continue

    alice, bob = (cookie_of(guarded.port, name) for name in ("alice", "bob"))
    threads = [threading.Thread(target=flood, args=(number,)) for number in range(4)]
    with (
        guarded.page("00000000000000aa", user="alice", cookie=alice) as driver,
        guarded.page("00000000000000bb", user="bob", cookie=bob) as stopper,
    ):
        driver.make_ready()
        stopper.until(lambda: stopper.state)
        for thread in threads:
            thread.start()
        try:
            driver.drive(0.1)
            took_s: list[float] = []
            # The flooding threads also delay this one, so take the fastest attempts.
            while not took_s or (min(took_s) >= STOP_S and len(took_s) < 4):
                watch = Stopwatch()
                assert stopper.answer("stop", t="stop")["ok"]
                took_s.append(watch.took_s)
            assert min(took_s) < STOP_S
            driver.until(lambda: driver.mode == "stopped")
        finally:
            ended.set()
            for thread in threads:
                thread.join()


# A release is never delayed behind a motion, and never lost.

DRIVE = '{"t":"drive","vx":0.5,"vy":0,"omega":0,"status_seq":%d}'


@pytest.mark.parametrize("last", ['{"t":"release"}', '{"t":"stop"}'])
def test_what_arrives_together_with_a_release_after_it_moves_nothing(
    served: Site, last: str
) -> None:
    with served.page() as page:
        page.make_ready()
        commands = CommandRecorder(served, page)
        at_once(page, *[DRIVE % page.state["status_seq"]] * 12, last)
        settle(page)
        assert not any(command.twist.any() for command in commands.take())
        assert page.mode in ("ready", "stopped")


def test_of_motions_that_arrive_together_the_newest_counts(served: Site) -> None:
    with served.page() as page:
        page.make_ready()
        commands = CommandRecorder(served, page)
        seen = page.state["status_seq"]
        at_once(page, *[DRIVE % seen] * 8, (DRIVE % seen).replace("0.5", "0.1"))
        page.until(lambda: page.last("released"))
        pushed = [command.twist[0] for command in commands.take() if command.twist.any()]
        assert pushed
        assert set(pushed) == {0.1}


def test_a_zero_is_said_again_until_the_robot_has_counted_it(served: Site) -> None:
    with served.page() as page:
        page.make_ready()
        page.drive()
        commands = CommandRecorder(served, page)
        page.holds = None
        page.send(t="release")
        page.until(lambda: page.mode == "ready")
        settle(page)
        sent = commands.take()
        assert commands.is_put_to_rest(sent)
        first = next(command for command in sent if not command.twist.any())
        assert page.state["status"]["command"]["seq"] >= first.seq
        settle(page)
        assert commands.take() == []


def test_to_a_robot_that_says_nothing_a_zero_is_said_for_half_a_second() -> None:
    """The lost message may be the status or the zero itself."""
    with robot_on_a_bus() as endpoint, Bus(client_config([endpoint])) as bus:
        made = Site(bus, 1, None)
        try:
            with made.page() as page:
                page.make_ready()
                page.drive()
                commands = CommandRecorder(made, page)
                made.deafen()
                page.let_go()
                sent, end_s = commands.take(), time.monotonic() + PATIENCE_S
                # Count messages, because a starved gateway sends each of them late.
                while zeros_at_the_end(sent) < 1 + ZERO_REPEATS and time.monotonic() < end_s:
                    time.sleep(0.02)
                    sent += commands.take()
                time.sleep(0.2)
                assert zeros_at_the_end(sent + commands.take()) == 1 + ZERO_REPEATS
        finally:
            made.close()


def test_the_next_motion_ends_the_zeros_of_the_last(served: Site) -> None:
    with served.page() as page:
        page.make_ready()
        page.drive()
        commands = CommandRecorder(served, page)
        for _ in range(RELEASES):
            page.send(t="release")
            time.sleep(0.015)
        sent: list[Command] = []

        def drives_on() -> bool:
            sent.extend(commands.take())
            return bool(sent) and all(command.twist.any() for command in sent[-10:])

        settle(page)
        page.until(drives_on)
        numbers = [command.seq for command in sent]
        assert numbers == sorted(numbers)
        moving = [bool(command.twist.any()) for command in sent]
        assert sum(before and not after for before, after in pairwise(moving)) <= RELEASES


# Work on another thread, caused by a page.


def test_of_the_same_work_no_more_than_one_waits() -> None:
    chores, begun, go = BackgroundWorker("test"), threading.Event(), threading.Event()
    done: list[int] = []
    others: list[int] = []

    def wait() -> None:
        begun.set()
        go.wait(10.0)

    chores.submit_latest("first", wait)
    assert begun.wait(10.0)
    for number in range(1000):
        chores.submit_latest("same", lambda number=number: done.append(number))
        chores.submit_latest(number % 3, lambda number=number: others.append(number))
    go.set()
    chores.close()
    assert done == [999]
    assert sorted(others) == [997, 998, 999]


def test_work_that_fails_does_not_end_the_rest(caplog: pytest.LogCaptureFixture) -> None:
    chores, done = BackgroundWorker("test"), threading.Event()

    def fail() -> None:
        raise ValueError("for a test")

    chores.submit_latest("fails", fail)
    chores.submit_latest("works", done.set)
    assert done.wait(10.0)
    chores.close()
    assert "for a test" in caplog.text
