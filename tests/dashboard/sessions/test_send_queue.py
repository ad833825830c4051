"""The queue for a slow page is bounded, keeps only the latest states, and spreads them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, cast

from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.dashboard.sessions.send_queue import (
    MAX_QUEUED,
    MAX_UNACKNOWLEDGED,
    Lane,
    SendQueue,
)


class Pipe:
    """A socket that accepts frames while its gate is open."""

    def __init__(self) -> None:
        self.sent_commands: list[str] = []
        self.gate = asyncio.Event()
        self.gate.set()

    async def send_str(self, data: str) -> None:
        await self.gate.wait()
        self.sent_commands.append(data)


def deliver(act: Callable[[SendQueue, Pipe], None]) -> list[str]:
    """Run `act`, let all tasks settle, and return the frames that reached the socket."""

    async def run() -> list[str]:
        queue, pipe = SendQueue(), Pipe()
        task = asyncio.create_task(queue.run(pipe))
        act(queue, pipe)
        pipe.gate.set()
        for _ in range(4 * MAX_QUEUED):  # More loop turns than there can be messages.
            await asyncio.sleep(0)
        task.cancel()
        return pipe.sent_commands

    return asyncio.run(run())


@given(st.integers(0, 3 * MAX_QUEUED))
def test_answers_keep_their_order_and_the_oldest_give_way(count: int) -> None:
    messages = [str(i) for i in range(count)]

    def act(queue: SendQueue, _pipe: Pipe) -> None:
        for message in messages:
            queue.put(message)

    assert deliver(act) == messages[-MAX_QUEUED:]


@given(st.integers(1, 50))
def test_of_states_that_wait_only_the_newest_is_sent(count: int) -> None:
    def act(queue: SendQueue, _pipe: Pipe) -> None:
        for number in range(count):
            queue.put_state(number, str(number))

    assert deliver(act) == [str(count - 1)]


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 3)), max_size=40))
def test_no_state_is_sent_twice(steps: list[tuple[int, int]]) -> None:
    """Even if two callbacks in a row put it; only a new robot resets this."""

    async def run() -> list[str]:
        queue, pipe, number = SendQueue(), Pipe(), 0
        task = asyncio.create_task(queue.run(pipe))
        for rise, turns in steps:
            number += rise
            queue.put_state(number, str(number))
            for _ in range(turns):
                await asyncio.sleep(0)
            for text in pipe.sent_commands:  # Only sent messages can be acknowledged.
                queue.acknowledge(int(text))
        for _ in range(4):
            await asyncio.sleep(0)
        sent = list(pipe.sent_commands)
        queue.drop_states()
        queue.put_state(number, "of another robot")
        for _ in range(4):
            await asyncio.sleep(0)
        task.cancel()
        assert pipe.sent_commands == [*sent, "of another robot"]
        return sent

    numbers = [int(each) for each in asyncio.run(run())]
    assert numbers == sorted(set(numbers))
    assert not steps or numbers[-1] == sum(rise for rise, _ in steps)


def test_a_page_that_confirms_nothing_is_sent_no_more_states_until_it_does() -> None:
    async def run() -> tuple[list[str], list[str]]:
        queue, pipe = SendQueue(), Pipe()
        task = asyncio.create_task(queue.run(pipe))

        async def send(numbers: range) -> None:
            for number in numbers:
                queue.put_state(number, str(number))
                await asyncio.sleep(0)
                await asyncio.sleep(0)

        await send(range(100))
        before = list(pipe.sent_commands)
        queue.acknowledge(5)
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        await send(range(100, 200))
        task.cancel()
        return before, pipe.sent_commands[len(before) :]

    before, after = asyncio.run(run())
    assert before == [str(number) for number in range(MAX_UNACKNOWLEDGED)]
    # Six of twelve were acknowledged, so six may follow, starting with the latest queued state.
    assert after == ["99", *(str(number) for number in range(100, 105))]


def test_a_confirmation_of_what_was_never_sent_changes_nothing() -> None:
    def act(queue: SendQueue, _pipe: Pipe) -> None:
        queue.acknowledge(7)
        queue.put_state(1, "state")

    assert deliver(act) == ["state"]


@given(st.integers(0, 3), st.integers(0, 3))
def test_a_stalled_lane_holds_up_one_state_and_no_reply(lanes: int, stalled: int) -> None:
    async def run() -> list[list[str]]:
        queue, pipes = SendQueue(), [Pipe() for _ in range(lanes + 1)]
        opened = [Lane(cast("Any", pipe)) for pipe in pipes[1:]]
        tasks = [asyncio.create_task(queue.run(cast("Any", pipes[0])))]
        for pipe in pipes[1 : stalled + 1]:
            pipe.gate.clear()
        for lane in opened:
            queue.add_lane(lane)
            tasks.append(asyncio.create_task(lane.run()))
        for number in range(40):
            queue.put_state(number, str(number))
            queue.put(f"reply {number}")
            queue.acknowledge(number - 1)
            for _ in range(4):
                await asyncio.sleep(0)
        for task in tasks:
            task.cancel()
        return [pipe.sent_commands for pipe in pipes]

    main, *others = asyncio.run(run())
    assert [text for text in main if "reply" in text] == [f"reply {i}" for i in range(40)]
    running = [main, *others[stalled:]]
    states = [int(text) for each in running for text in each if "reply" not in text]
    held_up = min(stalled, lanes)
    assert len(states) == len({*states}) == 40 - held_up
    shares = [sum("reply" not in text for text in each) for each in running]
    assert max(shares) - min(shares) <= 1 + held_up
