"""Simulated visitors: open the page, stay for a while, and leave."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import secrets
import time
from collections.abc import AsyncGenerator, Callable
from functools import partial
from importlib.metadata import version

import msgspec
import numpy as np
from websockets.asyncio.client import ClientConnection, connect
from websockets.typing import Subprotocol

from bench.programs import program
from bench.viewers import Tally, operate, watch
from tests.support.viser_client import CAMERA, decoded

_PROTOCOL = Subprotocol(f"viser-v{version('viser')}")
_LONGEST_VISIT_S = 5.0
_PATIENCE_S = 30.0


class CutOffError(Exception):
    """Raised if the server closes a page prematurely."""


@contextlib.asynccontextmanager
async def visit(url: str) -> AsyncGenerator[tuple[ClientConnection, ClientConnection, float]]:
    """Open a page; yield its sockets and the time until everything was received, s."""
    page, base = secrets.token_hex(8), url.replace("http://", "ws://")
    start_s = time.perf_counter()
    # Unbounded queue, because a full queue hides the response to a close frame.
    unbounded = partial(connect, compression=None, max_size=None, max_queue=None)
    async with (
        unbounded(f"{base}viser/{page}", subprotocols=[_PROTOCOL]) as scene,
        unbounded(f"{base}teleop?page={page}") as teleop,
    ):
        await scene.send(msgspec.msgpack.encode(CAMERA))
        async with asyncio.timeout(_PATIENCE_S):
            await replayed(scene)
        yield scene, teleop, time.perf_counter() - start_s


async def replayed(scene: ClientConnection) -> None:
    """Read until the initial scene is complete."""
    async for frame in scene:
        assert isinstance(frame, bytes)
        if any(message["type"] == "ReplayDoneMessage" for message in decoded(frame)):
            return
    raise CutOffError("the server closed a page before it had sent all")


async def drivers(url: str, each_s: float, drove: list[bool], robot: str = "") -> None:
    """Drive a robot, or the first one, repeatedly; record each time whether it moved."""
    while True:
        driving = asyncio.Event()
        async with visit(url) as (scene, teleop, _took_s):
            await stay(scene, teleop, each_s, driving, drives=True, robot=robot)
        drove.append(driving.is_set())


async def visitors(url: str, seed: int, connects_s: list[float]) -> None:
    """Open pages one after the other; every second one disconnects without a close frame."""
    chance = np.random.default_rng(seed)
    for number in itertools.count():
        async with visit(url) as (scene, teleop, took_s):
            connects_s.append(took_s)
            await stay(scene, teleop, chance.uniform(0.1, _LONGEST_VISIT_S), asyncio.Event())
            if number % 2:
                scene.transport.abort()
                teleop.transport.abort()
        await asyncio.sleep(chance.uniform(0.0, 1.0))


async def guests(robots: Callable[[], program], count: int, joined: list[int]) -> None:
    """Start and end robots, again and again; record how many have joined each time."""
    chance = np.random.default_rng(count)
    while True:
        some = robots()
        started = asyncio.ensure_future(asyncio.to_thread(some.__enter__))
        try:
            await asyncio.shield(started)
            joined.append(count)
            await asyncio.sleep(chance.uniform(1.0, _LONGEST_VISIT_S))
        finally:
            await started  # A cancelled start continues in its thread.
            await asyncio.to_thread(some.__exit__)


async def stay(
    scene: ClientConnection,
    teleop: ClientConnection,
    seconds: float,
    driving: asyncio.Event,
    *,
    drives: bool = False,
    robot: str = "",
) -> None:
    """Keep a page open for a duration.

    Raises:
        CutOffError: If the server closes it earlier.
    """
    ways = [
        asyncio.create_task(watch(scene, Tally())),
        asyncio.create_task(operate(teleop, Tally(), driving, drives=drives, robot=robot)),
    ]
    try:
        done, _ = await asyncio.wait(ways, timeout=seconds, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for way in ways:
            way.cancel()
        await asyncio.gather(*ways, return_exceptions=True)
    if done:
        raise CutOffError("the server closed a page")
