"""What a viser client is sent when it connects, in time that does not grow with uptime.

Every message that viser broadcasts gets the next id, and one that overtakes an older one (a newer
pose of the same node) removes it, so few are kept of many. viser 1.1.1 tries all ids from zero on
for each client that connects, on the loop that serves all of them: at 1200 poses a second the
hundred million ids of one day stop every picture for seconds. Here only what is kept is looked at.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Sequence
from functools import partial
from itertools import islice, takewhile
from operator import attrgetter

import viser
from viser.infra import Message
from viser.infra._async_message_buffer import AsyncMessageBuffer

from tsd_twin.errors import TwinError

VISER = "1.1.1"
"""The version whose inside this file knows."""

_BROADCAST = attrgetter("_websock_server._broadcast_buffer")
_METHOD = "_window_loop"


def refuse_other_versions() -> None:
    """Raise TwinError unless the viser that is installed is the one that this file knows."""
    if viser.__version__ != VISER:
        raise TwinError(
            f"viser {viser.__version__} is installed, and the dashboard needs {VISER}: "
            f"pip install viser=={VISER}"
        )


def skip_what_is_gone(server: viser.ViserServer) -> None:
    """Let clients that connect from now on be sent what is kept, and the rest be passed over.

    What is sent, and in which order, stays as it is. Only this server's broadcast changes: the
    queue that each client has besides is new with it, and starts at zero.
    """
    buffer: AsyncMessageBuffer = _BROADCAST(server)
    setattr(buffer, _METHOD, partial(windows, buffer))


async def windows(
    buffer: AsyncMessageBuffer, client_id: int, backlog_id: int, replay_done: Message | None
) -> AsyncGenerator[Sequence[Message]]:
    """Yield what is kept, and then what comes, for one client until the buffer is done.

    Takes the place of `AsyncMessageBuffer._window_loop`. `replay_done` follows `backlog_id`, the
    newest id when the client connected, and goes before anything newer.
    """
    cursors, sent_id = buffer.generator_cursors, -1
    flushed = asyncio.ensure_future(buffer.flush_event.wait())
    try:
        # viser forgets a removal only once all who are listed here have been sent it.
        cursors[client_id] = sent_id
        while not buffer.done:
            newest_id = buffer.message_counter - 1 if replay_done is None else backlog_id
            window, sent_id = next_window(buffer, client_id, sent_id, newest_id)
            cursors[client_id] = sent_id
            replayed = sent_id >= backlog_id and buffer.atomic_counter == 0
            if replay_done is not None and replayed:
                window.append(replay_done)
                replay_done = None
            if window:
                yield window
            else:
                await buffer.message_event.wait()
                buffer.message_event.clear()
            if window and sent_id < buffer.message_counter - 1:
                continue  # More is there already.
            # A frame's time, for what belongs together to come together, unless a flush cuts it.
            await asyncio.wait([flushed], timeout=buffer.window_duration_sec)
            if flushed.done() and not buffer.done:
                buffer.flush_event.clear()
                flushed = asyncio.ensure_future(buffer.flush_event.wait())
    finally:
        cursors.pop(client_id, None)
        flushed.cancel()
        await asyncio.wait([flushed])


def next_window(
    buffer: AsyncMessageBuffer, client_id: int, sent_id: int, newest_id: int
) -> tuple[list[Message], int]:
    """Return what is kept after `sent_id` up to `newest_id`, and the id that this leads up to.

    No more than a window holds, nothing that a client is not to be told of itself, and nothing
    while an atomic block is open.
    """
    with buffer.buffer_lock:
        if buffer.atomic_counter > 0:
            return [], sent_id
        kept = buffer.message_from_id
        # Ids are added in rising order, so that what is new stands at the end.
        new = [i for i in takewhile(sent_id.__lt__, reversed(kept)) if i <= newest_id]
        meant = (i for i in reversed(new) if kept[i].excluded_self_client != client_id)
        ids = list(islice(meant, buffer.max_window_size))
        full = len(ids) == buffer.max_window_size
        return [kept[i] for i in ids], ids[-1] if full else newest_id
