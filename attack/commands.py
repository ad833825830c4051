"""Attack with a command delayed past a stop and the next arming, for every shipped robot."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import numpy as np

from attack.operators import UncheckedOperator
from attack.table import Row
from tests.support.programs import Program
from tsd_twin import robots
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import BASE, TwistStamped, decode_odometry, encode_twist
from tsd_twin.messages.commands import encode_attachment
from tsd_twin.messages.topics import QoS, Service

MAX_AGE_S = 1.0
PUSHED_S = 0.5
WATCHED_S = 1.0
STILL_M = 0.001


def rows() -> Iterator[Row]:
    """Delay a command past STOP, reset and arm, and send it to the armed robot."""
    for name in robots.robot_names():
        flags = ("--robot", name, "--listen", "tcp/127.0.0.1:0", "--until-eof")
        program = Program(["tsd_mock", *flags])
        try:
            endpoint = program.ready().split()[-1]
            moved_m, ready_s = _late_command(endpoint, name)
        finally:
            program.process.kill()
        yield Row(
            "a command held back over STOP, reset and arm",
            f"moves it by no more than {1000 * STILL_M:g} mm",
            f"{1000 * moved_m:.1f} mm, after {ready_s:.1f} s",
            moved_m <= STILL_M,
            name,
            moved_m,
        )


def _late_command(endpoint: str, name: str) -> tuple[float, float]:
    """Return the travel after the late command, and its delay since STOP."""
    drive = robots.load_robot(name).kinematics()
    raw = UncheckedOperator(endpoint, name)
    commands = raw.bus.publisher(topics.twist_key(name, "raw"), QoS.REAL_TIME)
    try:
        raw.get_ready(MAX_AGE_S)
        raw.push(0.2)
        time.sleep(PUSHED_S)
        twist = np.zeros(6)
        twist[drive.twist_axes[0]] = 0.2
        late = encode_attachment(10**9, bytes.fromhex(raw.lease), raw.seen)
        raw.release()
        stopped_s = time.monotonic()
        raw.ask(Service.STOP, operator="bob")
        time.sleep(0.52)
        raw.ask(Service.RESET, lease=raw.lease)
        raw.ask(Service.ARM, lease=raw.lease)
        while raw.status.mode != "ready":
            if time.monotonic() - stopped_s > 10.0:
                raise TimeoutError(f"{name} does not become ready")
            time.sleep(0.005)
            raw.renew()
        before = _top(raw.newest["truth"].payload, name)
        late_s = time.monotonic() - stopped_s
        commands.put(encode_twist(TwistStamped(BASE, twist)), late)
        time.sleep(WATCHED_S)
        after = _top(raw.newest["truth"].payload, name)
        return math.dist(before, after), late_s
    finally:
        raw.close()


def _top(payload: bytes, name: str) -> tuple[float, ...]:
    """Return x and y of a robot, or the quaternion of a sphere."""
    truth = decode_odometry(payload, turning=name == "atlas")
    if truth.wxyz is not None:
        return tuple(truth.wxyz.tolist())
    return tuple(truth.xy_heading[:2].tolist())
