"""CPU load of idle nodes and of a dashboard without viewers, compared with bare loops."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack

from bench.programs import dashboard, mock, peer
from bench.table import Row, Run

_SETTLE_S = 2.0
_FLEET_MS = 400.0
_LOGGED_S = 12.0
"""Nodes keep the inputs of their first 10 s for a recorder."""
_ROUNDS = 11
"""Many short rounds, because the cost of a wake-up depends on what else runs."""


def rows(run: Run) -> Iterator[Row]:
    """Measure a disarmed robot that is read, a dashboard without a page, and a fleet."""
    seconds = run.pick(1.0, 0.3)
    node, bare = mock(), peer("node")
    with ExitStack() as stack:
        endpoint, bare_endpoint = stack.enter_context(node), stack.enter_context(bare)
        reader = peer("subscriber", endpoint)
        for each in (reader, peer("subscriber", bare_endpoint)):
            stack.enter_context(each)
        time.sleep(run.pick(_SETTLE_S, 0.1))
        yield from run.alternate(
            ["idle.node"],
            lambda: [node.load(seconds)],
            lambda: [bare.load(seconds)],
            rounds=_ROUNDS,
        )
        if run.wants("idle.dashboard"):
            page = dashboard(endpoint)
            stack.enter_context(page)
            time.sleep(run.pick(_SETTLE_S, 0.1))
            yield from run.alternate(
                ["idle.dashboard"],
                lambda: [page.load(seconds)],
                lambda: [reader.load(seconds)],
                rounds=_ROUNDS,
            )
    if run.wants("idle.fleet"):
        robots = mock("--id", "lab", "--count", "20")
        with robots as endpoint, dashboard(endpoint):
            time.sleep(run.pick(_LOGGED_S, 1.0))
            yield from run.alternate(
                ["idle.fleet"], lambda: [robots.load(seconds)], lambda: [_FLEET_MS], rounds=_ROUNDS
            )
