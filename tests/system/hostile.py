"""Hostile peer: `python -m tests.system.hostile ENDPOINT ROBOT SEED COUNT [WORD ...]`.

Sends malformed samples and requests at full speed, on every key. Only with the word `stop` does it
send messages that may stop the robot, because any peer may send those. With `ask` it sends only
requests, which cost the robot more than samples.
"""

from __future__ import annotations

import json
import random
import struct
import sys
from collections.abc import Callable

import numpy as np
import zenoh

from tsd_twin.bus import client_config
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import BASE, TwistStamped, encode_twist
from tsd_twin.messages.commands import encode_attachment
from tsd_twin.messages.topics import Service

_ASKS, _DELETES = 0.1, 0.1
"""Fractions of requests and deletions; the rest are puts."""
_WILD = (np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324)


def keys(robot: str, random: random.Random, *, stop: bool) -> list[str]:
    """Return concrete keys and patterns."""
    found = [
        topic.key(robot).replace("*", random.choice(["alice", "web-00000000", "x", "%00", "A B"]))
        for topic in topics.TOPICS
        if topic is not topics.STOP
    ]
    found += [
        topics.TWIST.key(robot),
        f"twin/{robot}/cmd/**",
        f"twin/{robot}/state/*",
        "twin/*/event/**",
        f"twin/{robot}/cmd/alice/twist/more",
        f"twin/ghost-{random.randrange(500)}/event/mode",
        "twin/NO ROBOT/event/mode",
        topics.alive_key(robot),
        *[service.key(robot) for service in Service if service is not Service.STOP],
    ]
    return [*found, topics.STOP.key(robot), f"twin/{robot}/**", "**"] if stop else found


def payload(random: random.Random) -> bytes:
    """Return an invalid payload."""
    makers: list[Callable[[], bytes]] = [
        lambda: b"",
        lambda: random.randbytes(random.randrange(200)),
        lambda: random.randbytes(random.choice([4095, 4097, 60_000])),
        lambda: twist(random)[: random.randrange(80)],
        lambda: twist(random, _WILD),
        lambda: twist(random),
        lambda: twist(random) + random.randbytes(8),
        lambda: b"[" * random.randrange(4000),
        lambda: b'{"lease": "' + b"\xff" * 32 + b'"}',
        lambda: text(random).encode(),
    ]
    return random.choice(makers)()


def twist(random: random.Random, wild: tuple[float, ...] = ()) -> bytes:
    """Return a command with wild numbers or an unknown frame."""
    numbers = np.array([random.choice([*wild, random.gauss(0.0, 1.0)]) for _ in range(6)])
    return encode_twist(TwistStamped(random.choice([BASE, BASE, "map", "b" * 300]), numbers))


def text(random: random.Random) -> str:
    """Return almost valid JSON requests, or valid ones without permission."""
    wild = ["00" * 16, random.randbytes(16).hex(), "", None, 1e999, -1, [], {}, "x" * 3000, True]
    fields = ("lease", "operator", "op", "take_over", "max_age_s", "x_m", "y_m", "heading_rad")
    made = {field: random.choice(wild) for field in fields if random.random() < 0.7}
    if random.random() < 0.3:
        made |= {"op": random.choice(["renew", "release"]), "operator": "mallory", "lease": wild[1]}
    return json.dumps(made)


def attachment(random: random.Random) -> bytes | None:
    """Return an attachment for a sample: none, noise, or a made-up lease."""
    kind = random.randrange(4)
    if kind == 0:
        return None
    if kind == 1:
        return random.randbytes(random.randrange(64))
    if kind == 2:
        return struct.pack("<Qq", 2**64 - 1, -(2**63))
    return encode_attachment(random.choice([0, 1, 2**64 - 1]), random.randbytes(16), 2**64 - 1)


def main(endpoint: str, robot: str, seed: int, count: int, what: list[str]) -> None:
    """Send the samples, and exit when all are sent."""
    stop, asks = "stop" in what, 1.0 if "ask" in what else _ASKS
    dice = random.Random(seed)  # noqa: S311  A flood that can be sent again is what is wanted.
    # Built in advance, because building is slower than sending.
    payloads = [payload(dice) for _ in range(400)]
    attachments = [attachment(dice) for _ in range(100)]
    services = [s.key(robot) for s in Service if stop or s is not Service.STOP]
    with zenoh.open(client_config([endpoint]).parsed()) as session:
        while not list(session.get(Service.DESC.key(robot), timeout=1.0)):
            pass
        for number in range(count):
            if number % 1000 == 0:
                places = [*services, *keys(robot, dice, stop=stop)]
            if dice.random() < asks:
                session.get(
                    dice.choice(services),
                    lambda _reply: None,
                    payload=dice.choice(payloads),
                    timeout=1.0,
                )
            elif dice.random() < asks:
                session.delete(dice.choice(places))
            else:
                session.put(
                    dice.choice(places),
                    dice.choice(payloads),
                    attachment=dice.choice(attachments),
                    congestion_control=zenoh.CongestionControl.BLOCK,
                )
        # A reply arrives after all earlier requests were processed.
        list(session.get(Service.DESC.key(robot), timeout=5.0))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]), sys.argv[5:])
