"""Discovery and stop of all robots on one or more buses."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tsd_twin.bus import Bus
from tsd_twin.client.discovery import instances_on, open_bus, robots_among, robots_on
from tsd_twin.client.errors import NoRobotFound, StopNotConfirmed
from tsd_twin.client.instances import is_ok, stop_instances
from tsd_twin.client.procedures import STOP_ANSWER_S, STOP_TRIES, stop_payload

_MAX_THREADS = 64


def find(
    endpoint: str | Sequence[str] | None = None,
    *,
    certificate: str | Path | None = None,
    zenoh_config: str | Path | None = None,
) -> list[str]:
    """Return the sorted ids of all robots, without replays of recordings.

    Takes the same arguments as `connect`.

    Raises:
        NoRobotFound: If nothing responds at an endpoint.
        TwinError: If a file is invalid.
    """
    found: set[str] = set()
    for each in _endpoints(endpoint):
        bus, _, _ = open_bus(each, certificate, zenoh_config)
        with bus:
            found.update(robots_on(bus))
    return sorted(found)


def stop_all(
    endpoint: str | Sequence[str] | None = None,
    *,
    reason: str = "",
    certificate: str | Path | None = None,
    zenoh_config: str | Path | None = None,
) -> list[str]:
    """Stop and latch all robots (software stop); return their ids after confirmation.

    Takes the same arguments as `connect`. Replays of recordings do not confirm.

    Raises:
        NoRobotFound: If the endpoints respond but there is no robot.
        StopNotConfirmed: If a robot or endpoint does not respond; all others are stopped.
        TwinError: If a file is invalid.
    """

    def stop_at(each: str | None) -> dict[str, bool]:
        try:
            bus, _, operator = open_bus(each, certificate, zenoh_config)
        except NoRobotFound:
            return {each or "the default endpoint": False}
        with bus:
            return _stop_on(bus, stop_payload(operator, reason))

    endpoints = _endpoints(endpoint)
    # In parallel, because an unreachable endpoint takes 3 s to time out.
    with ThreadPoolExecutor(len(endpoints)) as pool:
        stopped = [item for each in pool.map(stop_at, endpoints) for item in each.items()]
    if silent := sorted({name for name, is_stopped in stopped if not is_stopped}):
        raise StopNotConfirmed(silent)
    if not stopped:
        sentence = "no robot to stop: the endpoints answer, and have no robot"
        raise NoRobotFound(sentence, "no_robot")
    return sorted({robot_id for robot_id, _ in stopped})


async def find_async(
    endpoint: str | Sequence[str] | None = None,
    *,
    certificate: str | Path | None = None,
    zenoh_config: str | Path | None = None,
) -> list[str]:
    """Find all robots without blocking the event loop; see `find`."""
    return await asyncio.to_thread(
        find, endpoint, certificate=certificate, zenoh_config=zenoh_config
    )


async def stop_all_async(
    endpoint: str | Sequence[str] | None = None,
    *,
    reason: str = "",
    certificate: str | Path | None = None,
    zenoh_config: str | Path | None = None,
) -> list[str]:
    """Stop all robots without blocking the event loop; see `stop_all`."""
    return await asyncio.to_thread(
        stop_all, endpoint, reason=reason, certificate=certificate, zenoh_config=zenoh_config
    )


def _endpoints(endpoint: str | Sequence[str] | None) -> Sequence[str | None]:
    """Return endpoints to open in separate sessions; a shared session misses late ones."""
    return [endpoint] if endpoint is None or isinstance(endpoint, str) else list(endpoint)


def _stop_on(bus: Bus, payload: bytes) -> dict[str, bool]:
    """Stop all robots on a bus; return by id whether each confirmed."""
    instances = instances_on(bus)
    if not (robots := robots_among(instances)):
        return {}

    def is_stopped(robot_id: str) -> bool:
        for _ in range(STOP_TRIES):
            answer = stop_instances(bus, robot_id, payload, STOP_ANSWER_S, instances[robot_id])
            if answer is not None and is_ok(answer):
                return True
        return False

    with ThreadPoolExecutor(min(len(robots), _MAX_THREADS)) as pool:
        return dict(zip(robots, pool.map(is_stopped, robots), strict=True))
