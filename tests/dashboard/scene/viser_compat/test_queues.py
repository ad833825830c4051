"""Drawing from any thread wakes viser's event loop without touching its objects."""

from __future__ import annotations

import queue
import threading
from collections import deque
from collections.abc import Iterator
from typing import Any

from tests.dashboard.viser_internals import event_loop, queue_of, replace_waiters, shared_queue
from tests.support.viser_client import viser_client
from tests.support.withheld import PATIENCE_S
from tsd_twin.dashboard.scene import viser_compat

FRAMES = 400
PAUSE_S = 0.05


class Waiters(deque[Any]):
    """Records the waiters of an event and the threads that looked them up."""

    def __init__(self, before: deque[Any]) -> None:
        super().__init__(before)
        self.threads: set[int] = set()
        self.looked = threading.Event()

    def __iter__(self) -> Iterator[Any]:
        self.threads.add(threading.get_ident())
        self.looked.set()
        return super().__iter__()


def watched(server: Any, event: Any) -> tuple[Waiters, int]:
    """Record the waiters of the server's loop events, and return the thread of that loop."""
    found: list[tuple[Any, int]] = []
    done = threading.Event()

    def swap() -> None:
        found.append((replace_waiters(event, Waiters), threading.get_ident()))
        done.set()

    event_loop(server).call_soon_threadsafe(swap)
    assert done.wait(PATIENCE_S)
    return found[0]


def test_only_the_loop_looks_for_who_waits_whoever_fills_a_queue() -> None:
    server = viser_compat.start_server("test")
    come: queue.Queue[Any] = queue.Queue()
    server.on_client_connect(come.put)
    try:
        with viser_client(server.get_port()):
            client = come.get(timeout=PATIENCE_S)
            for filled, draw in (
                (shared_queue(server), server.scene.add_frame),
                (queue_of(client), client.scene.add_frame),
            ):
                waiters, loop_thread = watched(server, filled.message_event)
                # Spaced so that the loop waits for each next message.
                for i in range(FRAMES):
                    draw(f"/frame{i}")
                    if waiters.looked.wait(PAUSE_S):
                        break
                assert waiters.looked.is_set(), "the loop was never woken"
                assert waiters.threads == {loop_thread}
    finally:
        server.stop()
