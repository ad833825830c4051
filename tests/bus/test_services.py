"""Queries and replies between sessions."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TypeVar

import pytest
import zenoh

from tests.support.robot_node import raw_client
from tests.support.withheld import PATIENCE_S
from tsd_twin.bus import Bus
from tsd_twin.errors import NoAnswerError

KEY = "twin/r1/state/odom"
T = TypeVar("T")


def answering(bus: Bus, key: str, payload: bytes, *, patterns: bool = False) -> Callable[[], None]:
    """Serve a key on a thread; the returned function stops it."""
    server, stop = bus.queryable(key, patterns=patterns), threading.Event()

    def serve() -> None:
        while not stop.wait(0.005):
            for request in server.take_requests():
                request.reply(payload + request.payload)

    thread = threading.Thread(target=serve)
    thread.start()

    def end() -> None:
        stop.set()
        thread.join(PATIENCE_S)

    return end


def when_known(ask: Callable[[], T | None]) -> T:
    """Query until a reply arrives, because discovery takes a moment after opening."""
    end_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            answer = ask()
        except NoAnswerError:
            answer = None
        if answer is not None:
            return answer
        assert time.monotonic() < end_s, "there was no answer"


def test_a_question_is_answered(robot: Bus, connect: Callable[[], Bus]) -> None:
    end = answering(robot, "twin/r1/desc", b"you said ")
    client = connect()
    try:
        answer = when_known(lambda: client.query("twin/r1/desc", b"hello", PATIENCE_S))
        assert answer == b"you said hello"
        assert client.query("twin/r1/desc", b"", PATIENCE_S) == b"you said "
    finally:
        end()


def test_an_answer_to_a_pattern_names_the_one_who_answers(robot: Bus) -> None:
    ends = [
        answering(robot, f"twin/{name}/desc", name.encode(), patterns=True) for name in ("r1", "r2")
    ]

    def both() -> dict[str, bytes] | None:
        replies = client.get("twin/*/desc", timeout=PATIENCE_S)
        answers = {str(r.ok.key_expr): r.ok.payload.to_bytes() for r in replies if r.ok}
        return answers if len(answers) == len(ends) else None

    with raw_client(robot.endpoints()) as client:
        try:
            answers = when_known(both)
        finally:
            for end in ends:
                end()
    assert answers == {"twin/r1/desc": b"r1", "twin/r2/desc": b"r2"}


PATTERNS = ("**", "twin/**", "twin/r1/*", "twin/*/stop", "twin/r$*/stop")


def test_a_query_to_a_pattern_is_no_request(robot: Bus) -> None:
    """Patterns explore the bus; only a query to the exact key requests an action."""
    server = robot.queryable("twin/r1/stop")
    with raw_client(robot.endpoints()) as client:
        querier = client.declare_querier("twin/r1/stop")
        when_known(lambda: querier.matching_status.matching or None)
        for pattern in PATTERNS:
            client.get(pattern, zenoh.handlers.RingChannel(1), timeout=PATIENCE_S)
        answers = client.get("twin/r1/stop?why=me", payload=b"last", timeout=PATIENCE_S)
        taken: list[bytes] = []
        end_s = time.monotonic() + PATIENCE_S
        while not taken and time.monotonic() < end_s:
            for request in server.take_requests():
                taken.append(request.payload)
                request.reply(b"yes")
            time.sleep(0.005)
        assert taken == [b"last"]
        assert [answer.ok.payload.to_bytes() for answer in answers if answer.ok] == [b"yes"]


def test_who_asks_a_pattern_does_not_wait_for_an_answer_that_never_comes(
    robot: Bus, connect: Callable[[], Bus]
) -> None:
    end = answering(robot, "twin/r1/stop", b"")
    client = connect()
    try:
        assert when_known(lambda: client.query("twin/r1/stop", b"yes", PATIENCE_S)) == b"yes"
        start_s = time.monotonic()
        assert client.query_all("twin/**", b"", 60.0) == []
        assert time.monotonic() - start_s < 30.0
    finally:
        end()


def test_silence_is_an_error_that_names_the_key(robot: Bus, connect: Callable[[], Bus]) -> None:
    client = connect()
    with pytest.raises(NoAnswerError, match="twin/nobody/desc: no answer within"):
        client.query("twin/nobody/desc", b"", 0.2)
    robot.queryable("twin/r1/desc")  # A key on which no session serves requests.
    with pytest.raises(NoAnswerError, match=r"twin/r1/desc: no answer within 0\.2 s"):
        client.query("twin/r1/desc", b"", 0.2)
