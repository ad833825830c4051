"""Connecting is as fast after 100 million messages as after none, and yields the same state."""

from __future__ import annotations

import asyncio
import hashlib
import inspect
import threading
import time
from collections.abc import AsyncGenerator, Generator, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import viser
from hypothesis import given
from hypothesis import strategies as st
from viser.infra import ClientId, Message
from viser.infra._async_message_buffer import AsyncMessageBuffer

from tests.dashboard.viser_internals import (
    message_producer,
    queue_of,
    run_garbage_collector,
    shared_queue,
)
from tests.support.viser_client import ViserClient, viser_client
from tsd_twin.dashboard.scene import viser_compat
from tsd_twin.errors import TwinError

DAY = 100_000_000
"""Messages per day: ten robots with two poses each at 60 Hz."""


@pytest.fixture
def server() -> Generator[viser.ViserServer]:
    made = viser_compat.start_server("test")
    yield made
    made.stop()


def let_a_day_pass(server: viser.ViserServer) -> None:
    """Advance the counters as if this many superseded messages had been sent."""
    buffer = shared_queue(server)
    with buffer.buffer_lock:
        buffer.message_counter += DAY


def connect_s(server: viser.ViserServer) -> float:
    """Return the best of several connection times, because other processes interfere."""
    times_s = list[float]()
    for _ in range(5):
        start_s = time.perf_counter()
        with viser_client(server.get_port()):
            times_s.append(time.perf_counter() - start_s)
    return min(times_s)


def test_connecting_takes_no_longer_after_a_day_than_at_the_start(
    server: viser.ViserServer,
) -> None:
    """viser's own loop takes over 1000 times as long; a busy machine only a few times."""
    fresh_s = connect_s(server)
    let_a_day_pass(server)
    server.scene.add_frame("/new")  # Adds a gap between retained messages, not only before them.
    assert connect_s(server) < 20 * fresh_s


def test_who_comes_late_sees_what_those_see_who_were_there(server: viser.ViserServer) -> None:
    with viser_client(server.get_port()) as early:
        server.scene.add_frame("/kept", position=(1.0, 2.0, 3.0))
        gone = server.scene.add_frame("/gone")
        moved = server.scene.add_frame("/moved")
        server.gui.add_slider("speed", 0.0, 1.0, 0.1, 0.5)
        for x in range(100):
            moved.position = (float(x), 0.0, 0.0)
        let_a_day_pass(server)
        gone.remove()
        moved.wxyz = (0.0, 1.0, 0.0, 0.0)
        moved.visible = False
        server.scene.add_frame("/last", axes_length=0.25)
        early.until(lambda: early.node("/last") and not early.node("/moved").visible)
        with viser_client(server.get_port()) as late:
            assert {"/kept", "/moved", "/last"} <= late.shared.keys()
            assert "/gone" not in late.shared
            assert same_picture(early, late)
            assert tuple(late.node("/moved").position) == (99.0, 0.0, 0.0)
            assert late.controls == early.controls


def same_picture(one: ViserClient, other: ViserClient) -> bool:
    """Compared as text, because properties may contain arrays."""
    return repr(sorted(one.shared.items())) == repr(sorted(other.shared.items()))


def test_what_is_sent_while_clients_connect_reaches_all(server: viser.ViserServer) -> None:
    count = 1500
    begun, first = threading.Event(), server.scene.add_frame("/first")

    def send() -> None:
        for i in range(count):
            server.scene.add_frame(f"/{i}", show_axes=False)
            first.position = (float(i), 0.0, 0.0)
            begun.set()

    def complete(viewer: ViserClient) -> bool:
        return len(viewer.shared) > count and viewer.node("/first").position[0] == count - 1

    let_a_day_pass(server)
    sender = threading.Thread(target=send)
    with viser_client(server.get_port()) as early:
        sender.start()
        begun.wait()
        with viser_client(server.get_port()) as second, viser_client(server.get_port()) as third:
            sender.join()
            for viewer in (early, second, third):
                viewer.until(partial(complete, viewer))
            assert same_picture(early, second)
            assert same_picture(early, third)


def test_removals_are_forgotten_once_nobody_waits_for_them(server: viser.ViserServer) -> None:
    """viser polls each client's progress; one that left must not block removal."""
    buffer = shared_queue(server)
    with viser_client(server.get_port()) as viewer:
        server.scene.add_frame("/it").remove()
        server.scene.add_frame("/after")
        viewer.until(lambda: viewer.node("/after"))
        assert len(buffer.generator_cursors) == 1
    deadline_s = time.monotonic() + 10.0
    while buffer.generator_cursors:
        assert time.monotonic() < deadline_s, "a client that left is still counted"
        time.sleep(0.01)


@dataclass
class Note(Message):
    """A message of which only the latest per key is retained, as in viser."""

    thing: int
    number: int

    def redundancy_key(self) -> str:
        return str(self.thing)


END = Note(-1, -1)
DONE = Note(-2, -2)

Loop = AsyncGenerator[Sequence[Message]]


@dataclass(frozen=True)
class Burst:
    """A number of messages about a number of keys, some of which are excluded for a client."""

    count: int
    things: int
    seed: int

    def notes(self, first: int) -> Iterator[Note]:
        random = np.random.default_rng(self.seed)
        for number in range(first, first + self.count):
            note = Note(int(random.integers(self.things)), number)
            note.excluded_self_client = (None, ClientId(7), ClientId(8))[random.integers(3)]
            yield note


# The window size is 128, so bursts are smaller than one or span several.
bursts = st.builds(Burst, st.integers(0, 600), st.integers(1, 600), st.integers(0, 99))


async def told(loop_of: str, story: list[Burst], client: int) -> list[Note]:
    """Return the messages that a loop sends to a client connecting after the first burst."""
    queue = viser_compat.MessageQueue if loop_of == "ours" else AsyncMessageBuffer
    buffer = queue(asyncio.get_running_loop(), persistent_messages=True)
    buffer.window_duration_sec = 0.0
    came: list[Note] = []
    windows: Loop | None = None
    for burst in story:
        for note in burst.notes(buffer.message_counter):
            buffer.push(note)
        if windows is None:
            windows = buffer.window_generator(client, DONE)
            buffer.push(Note(0, -3))  # Live mode, although nothing has been sent yet.
        buffer.push(END)
        while END not in came:
            window = await anext(windows)
            assert len(window) <= buffer.max_window_size + (DONE in window)
            came += window
        came.remove(END)
        assert buffer.generator_cursors == {client: buffer.message_counter - 1}
    assert windows is not None
    await windows.aclose()
    assert not buffer.generator_cursors
    return came


@given(st.lists(bursts, min_size=1, max_size=4), st.sampled_from([7, 8, 9]))
def test_what_is_sent_and_in_which_order_is_as_viser_has_it(
    story: list[Burst], client: int
) -> None:
    """Order, content and end of the replay match viser's own loop."""
    theirs = asyncio.run(told("theirs", story, client))
    ours = asyncio.run(told("ours", story, client))
    assert ours == theirs
    assert ours.count(DONE) == 1


def test_nothing_is_sent_in_the_middle_of_an_atomic_block(server: viser.ViserServer) -> None:
    buffer = shared_queue(server)
    with server.atomic():
        server.scene.add_frame("/half")
        assert viser_compat.next_message_window(buffer, 0, -1, buffer.message_counter - 1) == (
            [],
            -1,
        )
    messages, _ = viser_compat.next_message_window(buffer, 0, -1, buffer.message_counter - 1)
    assert any(getattr(message, "name", None) == "/half" for message in messages)


def test_viser_uses_the_queue_for_all_clients_and_for_each(server: viser.ViserServer) -> None:
    assert type(shared_queue(server)) is viser_compat.MessageQueue
    with viser_client(server.get_port()) as viewer:
        viewer.until(lambda: server.get_clients())
        for client in server.get_clients().values():
            queue = queue_of(client)
            assert type(queue) is viser_compat.MessageQueue


KNOWN = {
    AsyncMessageBuffer: "a5346247208b3f6bb5dfca9bcacdbb62b3c08aea0904f2450cd2b1588b932bbe",
    message_producer: "8283328d06cfa014576888930c49a857a2d79892dc89f9694444895945018ea3",
    run_garbage_collector: ("3c5564f634e18ec9b2806717f16e8ffe663234738ea09a0c5db414387e012b7c"),
}
"""SHA-256 of the viser sources that our loop depends on."""


@pytest.mark.parametrize("inside", KNOWN)
def test_the_inside_of_viser_is_the_one_that_was_read(inside: type) -> None:
    """If this fails, review the changes in viser before updating the hash."""
    source = inspect.getsource(inside).encode()
    assert hashlib.sha256(source).hexdigest() == KNOWN[inside]


def test_the_version_is_the_one_that_is_installed_for_users() -> None:
    root = Path(__file__).parents[4]
    assert f'"viser=={viser_compat.VISER_VERSION}"' in (root / "pyproject.toml").read_text()


def test_another_version_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viser, "__version__", "9.9.9")
    before = set(threading.enumerate())
    with pytest.raises(TwinError, match=r"viser 9\.9\.9 is installed.*needs 1\.1\.1"):
        viser_compat.start_server("test")
    assert set(threading.enumerate()) == before
