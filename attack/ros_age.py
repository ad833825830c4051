"""Old twists from ROS, and robots with the same ROS name: ground-truth travel of each shipped
robot.

`python -m attack.ros_age --runs 10 --robots kiwi,tsd`. The ROS nodes are forged at the level of
rmw_zenoh, so that a stalled link needs no waiting: messages contain their sending time.
"""

# Some types of zenoh are incomplete.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import statistics
import struct
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zenoh

import tsd_twin
from attack.distances import ATTEMPTS, BEYOND_S, HASTE, REPEATED_S, quick_description
from attack.live import program
from attack.table import Row
from attack.track import TruthRecorder
from tests.support.programs import Program
from tests.support.ros_nodes import (
    TWIST,
    TWIST_STAMPED,
    ForeignNode,
    ForeignRobot,
    foreign_hash,
    ros_router,
)
from tsd_twin import robots
from tsd_twin.bus import Bus, client_config
from tsd_twin.errors import TwinError
from tsd_twin.messages.cdr import BASE, TwistStamped, encode_twist
from tsd_twin.messages.ros_types import encode_cdr, make_twist
from tsd_twin.robots import RobotDescription

PERIOD_S = 0.05
DRAIN = 3.0
"""Factor of the rate at which a link delivers delayed messages."""
PUSH_S = 1.0
DELAY_S = 3.0
FAST_S = 2.0
"""Time to learn a publisher's clock and to reach the speed limit."""
WATCHED_S = 0.4
PAUSED_S = 0.6
"""Pause after arming, without which a twist would be ignored."""
MOST_OTHERS = 70
MOVED_M = 0.01
PLAIN, ECHO, CROWDED = 0, 1, 2
"""Domains of adapters: `ECHO` requires the echo of `odom`; `CROWDED` is restarted for each case,
because an adapter remembers publishers for a minute."""


class Publisher:
    """Publisher of `cmd_vel` with a simulated clock offset."""

    def __init__(self, stage: Stage, domain: int = PLAIN) -> None:
        self._router, self._gid, self._sequence = stage.router, os.urandom(16), 0
        type_name = TWIST_STAMPED if domain == ECHO else TWIST
        dds = type_name.replace("/msg/", "::msg::dds_::").replace("/", "::") + "_"
        self._key = f"{domain}/cmd_vel/{dds}/{foreign_hash(type_name)}"
        self._stamped = domain == ECHO

    def send(self, twist: np.ndarray, age_s: float = 0.0, stamp_ns: int = 0) -> None:
        """Publish a twist (6,) with a sending time `age_s` ago by this publisher's clock."""
        self._sequence += 1
        if self._stamped:
            payload = encode_twist(TwistStamped(BASE, twist, stamp_ns))
        else:
            payload = encode_cdr(make_twist(tuple(twist)))
        sent_ns = time.time_ns() - round(1e9 * age_s)
        attachment = struct.pack("<qqB16s", self._sequence, sent_ns, 16, self._gid)
        self._router.put(self._key, payload, attachment=attachment)

    def live(self, twist: np.ndarray, duration_s: float) -> None:
        """Publish without delay."""
        for _ in range(round(duration_s / PERIOD_S)):
            self.send(twist)
            time.sleep(PERIOD_S)

    def drain(self, twist: np.ndarray, oldest_s: float, newest_s: float, set_s: float) -> None:
        """Deliver messages delayed by a stalled link, then a zero; the clock was set forward."""
        count = round((oldest_s - newest_s) / PERIOD_S / (1.0 - 1.0 / DRAIN))
        for i in range(count):
            self.send(twist, oldest_s - i * PERIOD_S * (1.0 - 1.0 / DRAIN) - set_s)
            time.sleep(PERIOD_S / DRAIN)
        self.send(np.zeros(6), newest_s - set_s)


@dataclass
class Stage:
    """Simulated robot with two adapters, in two ROS domains."""

    router: zenoh.Session
    port: int
    endpoint: str
    robot: RobotDescription
    truth: TruthRecorder
    adapter: Program | None = None
    """Process of the adapter in `PLAIN`."""

    @property
    def push(self) -> np.ndarray:
        """Twist (6,) at the speed limit."""
        drive, twist = self.robot.kinematics(), np.zeros(6)
        twist[drive.twist_axes[0]] = self.robot.limits.speed_mps / drive.twist_scale_m
        return twist

    @contextlib.contextmanager
    def shown(self, domain: int, *flags: str) -> Generator[Program]:
        """Show the robot in a domain of ROS."""
        to = ("--connect", self.endpoint, "--ros-connect", f"tcp/127.0.0.1:{self.port}")
        with program("tsd_ros", *to, "--domain", str(domain), *flags) as started:
            started.ready()
            yield started

    @contextlib.contextmanager
    def armed(self, domain: int = PLAIN) -> Generator[None]:
        """Arm with the service; disarm on exit."""
        node = ForeignNode(self.router, self.port, domain)
        end_s = time.monotonic() + 20.0
        while not (answer := node.call("/arm"))[0]:
            if time.monotonic() > end_s:
                raise TimeoutError(answer[1])
            node.call("/reset")  # A busy machine may have latched it.
            time.sleep(0.1)
        time.sleep(PAUSED_S)
        try:
            yield
        finally:
            while not (answer := node.call("/disarm"))[0]:
                if time.monotonic() > end_s:
                    raise TimeoutError(answer[1])

    def moved_since(self, time_s: float) -> float:
        """Return the distance since a time, once the robot is at rest."""
        time.sleep(WATCHED_S)
        self.truth.track.until_rest_after(time.monotonic())
        return self.truth.track.distance_since(time_s)


def _live(stage: Stage) -> float:
    publisher = Publisher(stage)
    with stage.armed():
        start_s = time.monotonic()
        publisher.live(stage.push, PUSH_S)
        return stage.moved_since(start_s)


def _new(stage: Stage) -> float:
    publisher = Publisher(stage)
    with stage.armed():
        start_s = time.monotonic()
        publisher.drain(stage.push, 4.0, 2.0, 0.0)
        return stage.moved_since(start_s)


def _evicted(stage: Stage) -> float:
    with stage.shown(CROWDED), stage.armed(CROWDED):
        publisher = _known(stage, CROWDED)
        for _ in range(MOST_OTHERS):
            Publisher(stage, CROWDED).send(np.zeros(6))
        time.sleep(PAUSED_S)
        start_s = time.monotonic()
        publisher.drain(stage.push, 4.0, 2.0, 0.0)
        return stage.moved_since(start_s)


def _known_stalls(stage: Stage) -> float:
    with stage.armed():
        publisher = _known(stage)
        start_s = time.monotonic()
        publisher.drain(stage.push, 4.0, 2.0, 0.0)
        return stage.moved_since(start_s)


def _clock_set(stage: Stage) -> float:
    with stage.armed():
        publisher = _known(stage)
        start_s = time.monotonic()
        publisher.drain(stage.push, 2.0, 0.4, 2.0)
        return stage.moved_since(start_s)


def _known(stage: Stage, domain: int = PLAIN) -> Publisher:
    """Return a publisher with a known clock, which has driven the robot and released it.

    Raises:
        TimeoutError: If it moves nothing, so that the attack would show nothing.
    """
    publisher = Publisher(stage, domain)
    for _ in range(ATTEMPTS):  # Its rate has to be steady, which a busy machine may prevent.
        start_s = time.monotonic()
        publisher.live(stage.push, PUSH_S)
        publisher.send(np.zeros(6))
        if stage.moved_since(start_s) > MOVED_M:
            break
        time.sleep(PAUSED_S)
    else:
        raise TimeoutError("a known publisher moves nothing")
    time.sleep(PAUSED_S)
    return publisher


def _hangs(stage: Stage) -> float:
    """Suspend the adapter while it repeats the last twist; return the distance since that twist.

    Raises:
        TimeoutError: If the robot did not reach full speed.
    """
    assert stage.adapter is not None
    publisher, pid = Publisher(stage), stage.adapter.process.pid
    with stage.armed():
        publisher.live(HASTE * stage.push, FAST_S)
        speed_mps = stage.truth.status.limits.speed_mps
        publisher.send(HASTE * stage.push)
        given_s = time.monotonic()
        time.sleep(REPEATED_S)
        os.kill(pid, signal.SIGSTOP)
        try:
            time.sleep(stage.robot.limits.max_command_age_s + BEYOND_S)
        finally:
            os.kill(pid, signal.SIGCONT)
        if not stage.truth.track.was_fast_at(given_s, speed_mps):
            raise TimeoutError("never at full speed")
        return stage.moved_since(given_s)


def _echo(stage: Stage, delay_s: float = 0.0) -> float:
    """Drive with the stamp of the latest `odom`, over a link with a constant delay.

    Returns the distance, with a delay only the part after the stick was released.
    """
    publisher, stamps = Publisher(stage, ECHO), deque[tuple[float, int]]()

    def note(sample: zenoh.Sample) -> None:
        sec, nanosec = struct.unpack_from("<iI", sample.payload.to_bytes(), 4)
        stamps.append((time.monotonic(), sec * 1_000_000_000 + nanosec))

    odom = stage.router.declare_subscriber(f"{ECHO}/odom/**", note)
    with stage.armed(ECHO):
        start_s = time.monotonic()
        while not stamps and time.monotonic() < start_s + 5.0:
            time.sleep(0.01)
        start_s = time.monotonic()
        released_s = start_s + PUSH_S
        while (now_s := time.monotonic()) < released_s + delay_s:
            sent_s = now_s - delay_s
            if sent_s >= start_s:
                seen = [stamp for at_s, stamp in list(stamps) if at_s <= sent_s]
                publisher.send(stage.push, delay_s, seen[-1] if seen else 0)
            time.sleep(PERIOD_S)
        moved_m = stage.moved_since(released_s if delay_s else start_s)
    odom.undeclare()
    return moved_m


def _collide(stage: Stage) -> float:
    """Drive a third-party robot that is imported with the ROS names of the armed robot."""
    with contextlib.ExitStack() as opened:
        opened.enter_context(stage.armed())
        start_s = time.monotonic()
        cart = ForeignRobot(stage.router, stage.port)
        opened.callback(cart.close)
        flags = ("--import", "burger", "--listen", "tcp/127.0.0.1:0", "--import-drive", "omni")
        ros = ("--ros-connect", f"tcp/127.0.0.1:{stage.port}", "--domain", str(PLAIN))
        adapter = opened.enter_context(program("tsd_ros", *flags, *ros))
        robot = opened.enter_context(tsd_twin.connect(adapter.ready().split()[-1]))
        control = robot.control("alice", arm=False)
        control.acquire()
        with contextlib.suppress(TwinError):
            control.arm()
        end_s = time.monotonic() + PUSH_S
        while time.monotonic() < end_s:
            with contextlib.suppress(TwinError):
                control.set_velocity(vx_mps=0.3)
            robot.sleep(PERIOD_S)
        with contextlib.suppress(TwinError):
            control.release()
        return stage.moved_since(start_s)


@dataclass(frozen=True)
class Case:
    """Attack, with its short name on the command line."""

    name: str
    text: str
    run: Callable[[Stage], float]
    stands: bool = False
    """Whether the robot must not move at all."""
    moves: bool = False
    """Whether the robot must move, because the publisher behaves correctly."""


CASES = (
    Case("live", "a new publisher without delay", _live, moves=True),
    Case("new", "a new publisher behind a stalled link: twists 2 to 4 s old", _new),
    Case("known", "a known publisher, twists 2 to 4 s old", _known_stalls),
    Case("evicted", "the same, and 70 other publishers came meanwhile", _evicted),
    Case("clock", "its clock is set 2 s forward as its link stalls", _clock_set),
    Case("hang", "last twist, adapter SIGSTOP 0.17 s later", _hangs),
    Case("echo", "--require-echo, without delay", _echo, moves=True),
    Case(
        "delay",
        f"--require-echo, {DELAY_S:g} s late, after the release",
        lambda it: _echo(it, DELAY_S),
    ),
    Case("collide", "a robot of the same ROS name is imported and driven", _collide, stands=True),
)


@contextlib.contextmanager
def _on_stage(name: str) -> Generator[Stage]:
    robot, text = quick_description(name)
    with contextlib.ExitStack() as opened:
        folder = Path(opened.enter_context(tempfile.TemporaryDirectory()))
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
        router, port = opened.enter_context(ros_router())
        flags = ("--listen", "tcp/127.0.0.1:0", "--robot", str(folder / f"{name}.toml"))
        endpoint = opened.enter_context(program("tsd_mock", *flags)).ready().split()[-1]
        bus = opened.enter_context(Bus(client_config([endpoint])))
        bus.wait_for_peer(5.0)
        truth = TruthRecorder(bus, robot.name, robot.kinematics())
        stage = Stage(router, port, endpoint, robot, truth)
        stage.adapter = opened.enter_context(stage.shown(PLAIN))
        opened.enter_context(stage.shown(ECHO, "--require-echo"))
        yield stage


def rows(names: Sequence[str] = (), cases: Sequence[str] = (), runs: int = 1) -> Iterator[Row]:
    """Yield a row per robot and case; one run of all cases takes about 60 s."""
    chosen = [case for case in CASES if case.name in (cases or [each.name for each in CASES])]
    for name in names or robots.robot_names():
        with _on_stage(name) as stage:
            for case in chosen:
                yield _row(stage, case, runs)


def _row(stage: Stage, case: Case, runs: int) -> Row:
    allowed_m = MOVED_M if case.stands else stage.robot.limits.stop_allowance_m
    ways_m, failure = list[float](), ""
    name = stage.robot.name
    promise = "moves it" if case.moves else f"moves it by at most {allowed_m:.2f} m"
    try:
        ways_m = [case.run(stage) for _ in range(runs)]
    except (TwinError, TimeoutError, AssertionError) as error:
        failure = f"{type(error).__name__}: {error}"[:80]
    if failure:
        return Row(case.text, promise, failure, False, name)
    worst_m = min(ways_m) if case.moves else max(ways_m)
    held = worst_m > MOVED_M if case.moves else worst_m <= allowed_m
    measured = f"{worst_m:.3f} m, median {statistics.median(ways_m):.3f} of {runs}"
    return Row(case.text, promise, measured, held, name, -worst_m if case.moves else worst_m)


def main() -> None:
    """Print the table row by row; exit with 1 if a guarantee was violated."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10, help="of each; default 10")
    parser.add_argument("--robots", default=",".join(robots.robot_names()), help="default: all")
    parser.add_argument("--cases", default=",".join(each.name for each in CASES))
    args: Any = parser.parse_args()
    broken, start_s = 0, time.monotonic()
    for line in rows(args.robots.split(","), args.cases.split(","), args.runs):
        print(line, flush=True)
        broken += not line.held
    verdict = f"{broken} broken" if broken else "all held"
    print(f"{verdict}, {time.monotonic() - start_s:.0f} s")
    sys.exit(1 if broken else 0)


if __name__ == "__main__":
    main()
