"""Chromium by its debugging protocol: processes to signal, tabs, pointers and keys."""

from __future__ import annotations

import contextlib
import itertools
import json
import re
import subprocess
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import psutil
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tests.support.browser import FLAGS_WITHOUT_SCENE, executable
from tests.support.withheld import PATIENCE_S, wait_for

_LOOK_EVERY_S = 0.03


class RefusedError(Exception):
    """Chromium refused a command, for example while a page is loading."""


class Chromium:
    """Separate browser with all its processes."""

    def __init__(self, profile: Path) -> None:
        self._process = subprocess.Popen(
            [
                executable(),
                *FLAGS_WITHOUT_SCENE,
                "--remote-debugging-port=0",
                "--touch-events=enabled",
                f"--user-data-dir={profile}",
                "about:blank",
            ],
            stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            text=True,
        )
        assert self._process.stderr is not None
        for line in self._process.stderr:
            if found := re.search(r"DevTools listening on (\S+)", line):
                break
        else:
            raise AssertionError("Chromium ended before it could be spoken to")
        self._deaf = threading.Thread(target=self._process.stderr.read)  # Or its pipe fills.
        self._deaf.start()
        self._socket = connect(found[1], compression=None, max_size=None)
        self._ids = itertools.count(1)
        self._news = threading.Condition()
        self._answers: dict[int, dict[str, Any]] = {}
        self._told: list[tuple[str, str]] = []
        self._gone = False
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            for text in self._socket:
                message = json.loads(text)
                with self._news:
                    if "id" in message:
                        self._answers[message["id"]] = message
                    elif message["method"] == "Runtime.bindingCalled":
                        self._told.append((message["sessionId"], message["params"]["payload"]))
                    self._news.notify_all()
        with self._news:
            self._gone = True
            self._news.notify_all()

    def say(self, method: str, session: str | None = None, **parameters: Any) -> int:
        """Send a command, and return its number."""
        number = next(self._ids)
        message = {"id": number, "method": method, "params": parameters}
        if session is not None:
            message["sessionId"] = session
        self._socket.send(json.dumps(message))
        return number

    def call(self, method: str, session: str | None = None, **parameters: Any) -> dict[str, Any]:
        """Send a command and return its result."""
        number = self.say(method, session, **parameters)
        with self._news:
            assert wait_for(self._news, lambda: number in self._answers or self._gone)
            assert number in self._answers, f"Chromium has gone before it answered {method}"
            answer = self._answers.pop(number)
        if "error" in answer:
            raise RefusedError(f"{method}: {answer['error']['message']}")
        return answer["result"]

    def told(self, session: str, event: str) -> float:
        """Wait for an event of a page; return the time of the event in the page."""

        def found() -> float | None:
            for each, text in self._told:
                kind, epoch_ms = text.split()
                if each == session and kind == event:
                    return float(epoch_ms) / 1000.0 - (time.time() - time.monotonic())
            return None

        with self._news:
            at_s = wait_for(self._news, found)
            assert at_s, f"the page never told of {event}: {self._told}"
            return at_s

    def forget(self) -> None:
        """Forget all that pages have told of."""
        with self._news:
            self._told.clear()

    def open(self, url: str, *, window: bool = False) -> Tab:
        """Open a page in a foreground tab or a separate window."""
        target = self.call("Target.createTarget", url=url, newWindow=window)["targetId"]
        session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        return Tab(self, target, session)

    def lives(self) -> bool:
        """Return whether its first process runs."""
        return self._process.poll() is None

    def send_signal(self, number: int) -> float:
        """Send a signal to all its processes, the first one first; return the time just before."""
        first = psutil.Process(self._process.pid)
        processes = [first, *first.children(recursive=True)]
        at_s = time.monotonic()
        for process in processes:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.send_signal(number)
        return at_s

    def close(self) -> None:
        """Leave nothing behind."""
        if self._process.poll() is None:
            first = psutil.Process(self._process.pid)
            for process in [first, *first.children(recursive=True)]:
                with contextlib.suppress(psutil.NoSuchProcess):
                    process.kill()
        self._process.wait(PATIENCE_S)
        self._socket.close()
        self._reader.join(PATIENCE_S)
        self._deaf.join(PATIENCE_S)
        assert self._process.stderr is not None
        self._process.stderr.close()


class Tab:
    """Tab with a page, and its keyboard and pointer input."""

    def __init__(self, browser: Chromium, target: str, session: str) -> None:
        self._browser, self._target, self._session = browser, target, session

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command to this page and return its result."""
        return self._browser.call(method, self._session, **parameters)

    def value(self, expression: str) -> Any:
        """Return the value of an expression in the page."""
        answer = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        if "exceptionDetails" in answer:
            raise RefusedError(answer["result"]["description"])
        return answer["result"].get("value")

    def until(self, expression: str) -> Any:
        """Wait until an expression is true in the page."""
        end_s, why = time.monotonic() + PATIENCE_S, ""
        while True:
            try:
                if value := self.value(expression):
                    return value
            except RefusedError as error:
                why = str(error)
            assert time.monotonic() < end_s, f"never: {expression} {why}"
            time.sleep(_LOOK_EVERY_S)

    def tell_of(self, events: Sequence[str]) -> None:
        """Record the times of events in the page; `when` waits for one."""
        self.call("Runtime.addBinding", name="tsdTell")
        self.value(
            f"for (const type of {json.dumps(events)}) addEventListener(type, (event) => "
            "tsdTell(`${type} ${performance.timeOrigin + performance.now()}`), {capture: true})"
        )

    def when(self, event: str) -> float:
        """Return the time of an event in the page."""
        return self._browser.told(self._session, event)

    def forget(self) -> None:
        """Forget what has happened so far."""
        self._browser.forget()

    def to_front(self) -> None:
        """Show the tab, as a click on it does."""
        self._browser.call("Target.activateTarget", targetId=self._target)

    def close(self) -> None:
        """Close the tab."""
        self._browser.call("Target.closeTarget", targetId=self._target)

    def key(self, letter: str, *, down: bool, control: bool = False, again: bool = False) -> None:
        """Press or release a letter key, optionally with Control; held keys repeat."""
        self.call(
            "Input.dispatchKeyEvent",
            type="keyDown" if down else "keyUp",
            key=letter,
            code=f"Key{letter.upper()}",
            windowsVirtualKeyCode=ord(letter.upper()),
            modifiers=2 * control,
            autoRepeat=again,
        )

    def touch(self, kind: str, *points: tuple[float, float, int]) -> None:
        """Let fingers, (x, y, id) each, `touchStart`, `touchMove`, `touchEnd` or `touchCancel`.

        The protocol wants all fingers that are down after a start or a move, and for an end those
        that stay.
        """
        fingers = [{"x": x, "y": y, "id": number} for x, y, number in points]
        self.call("Input.dispatchTouchEvent", type=kind, touchPoints=fingers)
