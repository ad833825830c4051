"""Load generator for viewers: `python -m bench.viewers URL COUNT [drive|fleet|scene]`.

The reported `counter` belongs to the viewer with the most data. With `drive`, the first viewer
takes control and drives a circle. With `fleet`, each viewer selects one of the robots lab0, lab1,
and so on, and the second to fifth drive. With `scene`, the address belongs to a plain viser server.
"""

from __future__ import annotations

import asyncio
import itertools
import json
import math
import secrets
import sys
import time
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any

import msgspec
from websockets.asyncio.client import ClientConnection, connect
from websockets.typing import Subprotocol

from tests.support.viser_client import CAMERA, decoded

_WARM_UP_S, _ASK_AGAIN_S = 1.5, 2.0
_MOVES = ("SetPositionMessage", "SetOrientationMessage")


class Tally:
    """Byte counter of received messages, once started."""

    decodes = counting = False

    def start(self) -> None:
        """Count from zero."""
        self.scene = self.teleop = self.frames = self.moves = self.messages = 0
        self.states = self.driving = 0
        self.counting = True

    def note(self, mode: str) -> None:
        """Count a state of the robot."""
        if self.counting:
            self.states += 1
            self.driving += mode == "driving"

    @property
    def driven(self) -> float:
        """Fraction of the states with a robot that drives."""
        return self.driving / max(self.states, 1)


async def main(url: str, count: int, what: str) -> None:
    """Connect all viewers, wait until the robots drive, and count when asked."""
    tallies = [Tally() for _ in range(count)]
    tallies[0].decodes = count == 1 or what == "fleet"
    events = [asyncio.Event() for _ in tallies]
    drivers = {"fleet": range(1, 5), "drive": range(1)}.get(what, range(0))
    views: list[Coroutine[Any, Any, None]] = []
    for i, (tally, event) in enumerate(zip(tallies, events, strict=True)):
        if what == "scene":
            views.append(view_scene(url, tally, event))
        else:
            robot = f"lab{i}" if what == "fleet" else ""
            views.append(view(url, tally, event, drives=i in drivers, robot=robot))
    tasks = [asyncio.create_task(each) for each in views]
    async with asyncio.timeout(60):
        for event in events:
            await event.wait()
    await asyncio.sleep(_WARM_UP_S)  # Exclude the initial scene of half a megabyte.
    print("ready:", url, flush=True)
    while await asyncio.to_thread(sys.stdin.readline):
        for tally in tallies:
            tally.start()
        start = time.monotonic()
        await asyncio.to_thread(sys.stdin.readline)
        took_s = time.monotonic() - start
        result = {
            "scene_kB_s": max(tally.scene for tally in tallies) / took_s / 1000,
            "teleop_kB_s": max(tally.teleop for tally in tallies) / took_s / 1000,
            "frames_hz": min(tally.frames for tally in tallies) / took_s,
            "moves_hz": tallies[0].moves / took_s,
            "messages_hz": tallies[0].messages / took_s,
            "driving": min((tallies[i].driven for i in drivers if i < count), default=1.0),
        }
        print(json.dumps(result), flush=True)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def view(
    url: str, tally: Tally, driving: asyncio.Event, *, drives: bool, robot: str = ""
) -> None:
    """Run a page: one socket for the scene and one for the controls; select `robot`, if any."""
    page = secrets.token_hex(8)
    base = url.replace("http://", "ws://")
    async with (
        connect(
            f"{base}viser/{page}",
            subprotocols=[Subprotocol("viser-v1.1.1")],
            compression=None,
            max_size=None,
        ) as scene,
        connect(f"{base}teleop?page={page}", compression=None) as teleop,
    ):
        await scene.send(msgspec.msgpack.encode(CAMERA))
        operating = operate(teleop, tally, driving, drives=drives, robot=robot)
        await asyncio.gather(watch(scene, tally), operating)


async def view_scene(url: str, tally: Tally, connected: asyncio.Event) -> None:
    """Show the scene of a plain viser server."""
    protocols = [Subprotocol("viser-v1.1.1")]
    async with connect(url, subprotocols=protocols, compression=None, max_size=None) as scene:
        await scene.send(msgspec.msgpack.encode(CAMERA))
        connected.set()
        await watch(scene, tally)


async def watch(scene: ClientConnection, tally: Tally) -> None:
    """Count the data of the scene."""
    async for frame in scene:
        if tally.counting:
            tally.scene += len(frame)
            tally.frames += 1
            if tally.decodes and isinstance(frame, bytes):
                kinds = [each["type"] for each in decoded(frame)]
                tally.messages += len(kinds)
                tally.moves += sum(kind in _MOVES for kind in kinds)


async def operate(
    teleop: ClientConnection,
    tally: Tally,
    driving: asyncio.Event,
    *,
    drives: bool,
    robot: str = "",
) -> None:
    """Send heartbeats like a page, and drive a circle if `drives`.

    `driving` is set once the robot drives, for other viewers once it is shown.
    """
    shown = ""
    seen: dict[str, Any] = {"status_seq": 0, "mode": "", "has_control": False}
    asked_s: dict[str, float] = {}

    async def send(**message: Any) -> None:
        await teleop.send(json.dumps(message))

    sending = asyncio.create_task(send_commands(send, seen, drives=drives))
    try:
        async for text in teleop:
            if tally.counting:
                tally.teleop += len(text)
            message = json.loads(text)
            if message["t"] == "released":
                await send(t="release")  # Like a page whose controls have sprung back.
            if message["t"] == "welcome" and robot in {each["id"] for each in message["robots"]}:
                await send(t="robot", id=robot)
            if message["t"] == "robot":
                shown = message["id"]
            if message["t"] != "state" or (robot and shown != robot):
                continue
            seen["status_seq"], seen["mode"] = message["status_seq"], message["status"]["mode"]
            seen["has_control"] = message["has_control"]
            tally.note(seen["mode"])
            if not drives or seen["mode"] == "driving":
                driving.set()
            elif (request := next_request(message, asked_s)) is not None:
                await send(**request)
    finally:
        sending.cancel()


async def send_commands(
    send: Callable[..., Awaitable[None]], seen: dict[str, Any], *, drives: bool
) -> None:
    """Send heartbeats at 10 Hz and commands at 50 Hz."""
    for tick in itertools.count():
        if tick % 5 == 0:
            await send(t="heartbeat", status_seq=seen["status_seq"], sent_ms=0.0, focus=True)
        if drives and seen["has_control"] and seen["mode"] in ("ready", "driving"):
            await send(t="drive", vx=0.4, vy=0.1, omega=0.8, status_seq=seen["status_seq"])
        await asyncio.sleep(0.02)


def next_request(state: dict[str, Any], asked_s: dict[str, float]) -> dict[str, Any] | None:
    """Return the next request towards driving, again if it had no effect for a while."""
    now_s = time.monotonic()
    for wanted, request in (
        (not state["has_control"], {"t": "lease", "op": "acquire"}),
        (state["has_control"] and state["status"]["mode"] == "disarmed", {"t": "arm"}),
    ):
        if wanted and now_s - asked_s.get(request["t"], -math.inf) >= _ASK_AGAIN_S:
            asked_s[request["t"]] = now_s
            return request
    return None


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2]), sys.argv[3]))
