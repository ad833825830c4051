"""Finding a robot on the bus."""

from __future__ import annotations

import time

from tsd_twin import topics
from tsd_twin.bus import Bus
from tsd_twin.errors import NoAnswerError, TwinError
from tsd_twin.messages.service import Description, decode_json
from tsd_twin.topics import Service

_MEETING_S = 5.0


def description(bus: Bus, robot_id: str) -> str:
    """Return the TOML of a robot; who has just joined the bus may not hear of it at once."""
    end_s = time.monotonic() + _MEETING_S
    while True:
        try:
            answer = bus.ask(Service.DESC.key(robot_id), b"")
            return decode_json(answer, Description, "a description").robot
        except NoAnswerError:
            if time.monotonic() > end_s:
                raise


def only_robot(bus: Bus) -> str:
    """Return the id of the robot on the bus.

    Raises:
        TwinError: there is none, or more than one.
    """
    found = sorted(topics.robot_of(key) for key in bus.living(topics.alive_key("*")))
    if len(found) != 1:
        raise TwinError(
            f"choose one with --id: {', '.join(found)} are on the bus"
            if found
            else "no robot is on the bus: start tsd-bridge or tsd-mock, or say --connect"
        )
    return found[0]
