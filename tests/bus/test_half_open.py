"""A session whose handshake succeeds just as Zenoh gives up on it."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import threading
import time
from collections.abc import Generator
from pathlib import Path

import msgspec
import pytest
import zenoh

from tests.support.link_sockets import Relay
from tests.support.robot_node import Mailbox, bus_and_session, running
from tests.support.secured_robot import SecuredRobot, make_keys
from tests.support.withheld import PATIENCE_S
from tsd_twin.bus import Bus, Config, client_config
from tsd_twin.messages import topics
from tsd_twin.messages.status import decode_status
from tsd_twin.messages.topics import Service

OPEN_S = 1.0
"""Handshake timeout; 5 s by default."""
EARLY_S = 0.2
LATE_S = 0.6
"""The handshake succeeds 0.2 s before the timeout; its last step ends 0.6 s after it."""


def hurried(config: Config) -> Config:
    """Return a configuration with a shorter handshake timeout."""
    return dataclasses.replace(
        config, others={"transport/unicast/open_timeout": json.dumps(round(1000 * OPEN_S))}
    )


@contextlib.contextmanager
def robot(kind: str, folder: Path) -> Generator[tuple[str, Config]]:
    """Run a robot; yield its endpoint and an operator's configuration."""
    if kind == "tcp":
        with running() as node:
            yield node.endpoint, client_config([node.endpoint])
        return
    secured = SecuredRobot(make_keys(folder / "keys"))
    try:
        yield secured.endpoint, secured.config("alice")
    finally:
        secured.close()


@contextlib.contextmanager
def half_open(endpoint: str, config: Config) -> Generator[tuple[Bus, zenoh.Session]]:
    """Open a session whose first connection Zenoh gives up while adding it.

    A link listener runs within that last step, so a slow one delays it.
    """
    slept = threading.Event()

    def sleep_once(event: zenoh.LinkEvent) -> None:
        if event.kind == zenoh.SampleKind.PUT and not slept.is_set():
            slept.set()
            time.sleep(LATE_S)

    with Relay(endpoint, first_wait_s=OPEN_S - EARLY_S) as relay:
        settings = hurried(config)
        endpoints = json.dumps([relay.endpoint])
        others = {**settings.others, "connect/endpoints": endpoints}
        slow = zenoh.handlers.Callback(sleep_once, indirect=False)
        with (
            bus_and_session(dataclasses.replace(settings, others=others)) as (bus, session),
            session.info.declare_link_events_listener(slow),
        ):
            assert slept.wait(PATIENCE_S)
            yield bus, session


@pytest.mark.parametrize("kind", ["tcp", "tls"])
def test_a_connection_given_up_while_it_was_made_is_made_anew(kind: str, tmp_path: Path) -> None:
    with (
        robot(kind, tmp_path) as (endpoint, config),
        half_open(endpoint, config) as (bus, session),
    ):
        statuses = Mailbox()
        bus.subscribe(topics.STATUS.key("tsd"), statuses)
        statuses.next()
        # Earlier declarations work in both directions, over a single connection.
        assert msgspec.json.decode(bus.query(Service.STOP.key("tsd"), b"{}", PATIENCE_S))["ok"]
        while decode_status(statuses.next().payload).mode != "stopped":
            pass
        assert len(session.info.transports()) == len(session.info.links()) == 1


def test_a_connection_made_in_time_is_kept() -> None:
    losses = threading.Event()
    with (
        running() as node,
        Relay(node.endpoint, on_given_up=losses.set) as relay,
        Bus(hurried(client_config([relay.endpoint]))) as bus,
    ):
        statuses = Mailbox()
        bus.subscribe(topics.STATUS.key("tsd"), statuses)
        begin_s = time.monotonic()
        while time.monotonic() < begin_s + OPEN_S:
            statuses.next()
        assert not losses.is_set()
