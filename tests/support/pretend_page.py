"""Page without a browser, in a separate process: `python -m tests.support.pretend_page URL`.

Implements `docs/teleop.md`. Reads actions as lines on standard input: `ready [MAX_AGE_S]`,
`push VX`, `insist VX` (after a forced release, take control and push again), `release`, `freeze`
(send nothing more), `close`. Writes observations as lines of JSON.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import os
import secrets
import subprocess
import sys
import threading
import time
from typing import Any

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

from tests.support.withheld import PATIENCE_S, wait_for

PERIOD_S = 0.02
_BEAT_EVERY = 5
_ASK_AGAIN_S = 0.5


class Hand:
    """Intention of the simulated user."""

    def __init__(self) -> None:
        self.vx: float | None = None
        self.insists = False
        self.wants_ready = False
        self.max_age_s: float | None = None


class Page:
    """Teleop socket and its user."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self._hand = Hand()
        self._seen = 0
        self._asked_s = 0.0

    async def run(self) -> None:
        """Receive and send until the socket is closed."""
        tasks = [asyncio.create_task(self._speak()), asyncio.create_task(self._obey())]
        try:
            async for text in self._socket:
                await self._hear(json.loads(text))
        except ConnectionClosed:
            pass
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            tell("lost")

    async def _say(self, **message: Any) -> None:
        await self._socket.send(json.dumps(message))

    async def _speak(self) -> None:
        for tick in itertools.count():
            if tick % _BEAT_EVERY == 0:
                await self._say(t="heartbeat", status_seq=self._seen, sent_ms=0.0, focus=True)
            if (vx := self._hand.vx) is not None:
                await self._say(t="drive", vx=vx, vy=0.0, omega=0.0, status_seq=self._seen)
            await asyncio.sleep(PERIOD_S)

    async def _hear(self, message: dict[str, Any]) -> None:
        match message["t"]:
            case "state":
                self._seen = message["status_seq"]
                if self._hand.wants_ready or self._hand.insists:
                    await self._get_ready(message)
            case "released":
                tell("released", message["why"]["code"])
                if self._hand.insists:
                    await self._say(t="release")
            case "reply" if not message["ok"]:
                tell("refused", f"{message['to']}: {message['why']['code']}")
            case _:
                pass

    async def _get_ready(self, state: dict[str, Any]) -> None:
        """Take the next step towards `ready`."""
        mode = state["status"]["mode"]
        if state["has_control"] and mode == "ready":
            if self._hand.wants_ready:
                self._hand.wants_ready = False
                tell("ready")
        elif time.monotonic() - self._asked_s > _ASK_AGAIN_S:
            self._asked_s = time.monotonic()
            if not state["has_control"]:
                age_s = self._hand.max_age_s
                await self._say(t="lease", op="acquire", take_over=True, max_age_s=age_s)
            elif mode in ("stopped", "fault"):
                await self._say(t="reset")
            elif mode == "disarmed":
                await self._say(t="arm")

    async def _obey(self) -> None:
        lines = asyncio.StreamReader()
        loop = asyncio.get_running_loop()
        await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(lines), sys.stdin)
        while line := await lines.readline():
            await self._do(*line.decode().split())
        await self._socket.close()

    async def _do(self, what: str, *number: str) -> None:
        hand = self._hand
        match what:
            case "ready":
                hand.wants_ready, hand.max_age_s = True, float(number[0]) if number else None
            case "push" | "insist":
                hand.vx, hand.insists = float(number[0]), what == "insist"
            case "release" | "freeze":
                hand.vx, hand.insists = None, False
                if what == "release":
                    await self._say(t="release")
            case "close":
                hand.vx = None
                tell("done", what)  # Closing ends all tasks, so report first.
                await self._socket.close()
                return
            case _:
                raise ValueError(what)
        tell("done", what)


class PretendPage:
    """Handle of the page process."""

    def __init__(self, url: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.support.pretend_page", url],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._news = threading.Condition()
        self.notices: list[dict[str, Any]] = []
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            with self._news:
                self.notices.append(json.loads(line))
                self._news.notify_all()

    def do(self, *words: object) -> float:
        """Send an input to the page; return the time at which it was applied."""
        assert self.process.stdin is not None
        before = len(self.notices)
        self.process.stdin.write(" ".join(map(str, words)) + "\n")
        self.process.stdin.flush()
        return float(self.until("done", before)["at_s"])

    def until(self, what: str, since: int = 0) -> dict[str, Any]:
        """Wait for an event of the page and return it."""

        def found() -> dict[str, Any] | None:
            return next((n for n in self.notices[since:] if n["what"] == what), None)

        with self._news:
            notice = wait_for(self._news, found)
            assert notice, f"the page never said '{what}': {self.notices}"
            return notice

    def count(self, what: str) -> int:
        """Return the number of events of a kind."""
        return sum(notice["what"] == what for notice in self.notices)

    def get_ready(self, max_age_s: float | None = None) -> None:
        """Take control and arm."""
        before = len(self.notices)
        self.do("ready", *([] if max_age_s is None else [max_age_s]))
        self.until("ready", before)

    def send_signal(self, number: int) -> float:
        """Send a signal to the process; return the time just before."""
        return send_signal(self.process.pid, number)

    def clean_up(self) -> None:
        """End the process and close its pipes."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(PATIENCE_S)
        self._reader.join(PATIENCE_S)
        for stream in (self.process.stdin, self.process.stdout):
            if stream is not None:
                with contextlib.suppress(BrokenPipeError):
                    stream.close()


def send_signal(pid: int, number: int) -> float:
    """Send a signal; return the time just before."""
    at_s = time.monotonic()
    os.kill(pid, number)
    return at_s


def tell(what: str, why: str = "") -> None:
    """Report an event and its time."""
    sys.stdout.write(json.dumps({"what": what, "why": why, "at_s": time.monotonic()}) + "\n")
    sys.stdout.flush()


async def main(url: str) -> None:
    """Open the socket of a page."""
    address = url.replace("http://", "ws://") + f"teleop?page={secrets.token_hex(8)}"
    async with connect(address, compression=None) as socket:
        await Page(socket).run()


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1]))
