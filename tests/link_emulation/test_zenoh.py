"""A dashboard and a robot on a real bus, with a bad link between them."""

from __future__ import annotations

import contextlib
import math
import queue
import statistics
import time
from collections.abc import Generator
from dataclasses import dataclass, field

import pytest
import zenoh

from tests.support.robot_node import bus_and_session
from tests.support.withheld import PATIENCE_S, WithheldTime
from tsd_twin.bus import Bus, client_config, node_config
from tsd_twin.link_emulation import LinkEmulator, LinkSpec
from tsd_twin.messages.topics import QoS

pytestmark = pytest.mark.system

PERIOD_S = 0.02
LEASE_S = 1.0
"""As configured by `tsd_twin.bus`."""


@dataclass
class Drive:
    """An operator who sends numbers, and the numbers seen by robot and operator."""

    simulator: LinkEmulator
    commands: zenoh.Publisher
    sent_s: list[float] = field(default_factory=list)
    received: queue.Queue[tuple[int, float]] = field(default_factory=queue.Queue)
    echoed: queue.Queue[tuple[int, float]] = field(default_factory=queue.Queue)

    def send(self) -> int:
        """Send the next number."""
        number = len(self.sent_s)
        self.sent_s.append(time.monotonic())
        self.commands.put(str(number).encode())
        return number

    def send_for(self, length_s: float, period_s: float = PERIOD_S) -> None:
        """Send at the command rate."""
        end_s = time.monotonic() + length_s
        while time.monotonic() < end_s:
            self.send()
            time.sleep(period_s)

    def arrive(self) -> list[tuple[int, float]]:
        """Send until a number arrives; return all that arrived, each with its age."""
        last = self.send()
        arrived: list[tuple[int, float]] = []
        end_s = time.monotonic() + PATIENCE_S
        while not arrived or arrived[-1][0] < last:
            assert time.monotonic() < end_s, "the bus did not come back"
            try:
                number, at_s = self.received.get(timeout=10 * PERIOD_S)
            except queue.Empty:
                self.send()
                continue
            arrived.append((number, at_s - self.sent_s[number]))
        return arrived

    def round_trips_s(self, count: int = 15) -> tuple[list[float], list[float]]:
        """Measure round-trip times of numbers to the robot, and those without withheld time."""
        trips_s: list[float] = []
        own_s: list[float] = []
        for _ in range(count):
            with WithheldTime() as withheld:
                number = self.send()
                while (echo := self.echoed.get(timeout=PATIENCE_S))[0] != number:
                    pass
            trips_s.append(echo[1] - self.sent_s[number])
            own_s.append(trips_s[-1] - withheld.total_s)
        return trips_s, own_s


@contextlib.contextmanager
def driving(protocol: str) -> Generator[Drive]:
    """Link two sessions through an initially transparent simulator."""
    with Bus(node_config([f"{protocol}/127.0.0.1:0"])) as robot:
        (endpoint,) = robot.endpoints()
        with (
            LinkEmulator(LinkSpec(), f"{protocol}/127.0.0.1:0", endpoint) as simulator,
            bus_and_session(client_config([simulator.endpoint])) as (dashboard, session),
        ):
            # Block where `Bus` drops on a busy machine, so that missing numbers were lost by the
            # link.
            commands = session.declare_publisher(
                "there", congestion_control=zenoh.CongestionControl.BLOCK, express=True
            )
            drive = Drive(simulator, commands)
            echo = robot.publisher("back", QoS.REAL_TIME)

            def take(payload: bytes) -> None:
                drive.received.put((int(payload), time.monotonic()))
                echo.put(payload)

            robot.subscribe("there", lambda sample: take(sample.payload))
            dashboard.subscribe(
                "back", lambda sample: drive.echoed.put((int(sample.payload), time.monotonic()))
            )
            # Each side learns of the other's subscriptions at its own time.
            while drive.echoed.empty():
                drive.send()
                with contextlib.suppress(queue.Empty):
                    drive.echoed.put(drive.echoed.get(timeout=PERIOD_S))
            drive.arrive()
            yield drive


@pytest.mark.parametrize("protocol", ["tcp", "udp"])
def test_a_round_trip_grows_by_twice_the_delay(protocol: str) -> None:
    with driving(protocol) as drive:
        _, before_s = drive.round_trips_s()
        drive.simulator.set(LinkSpec(delay_s=0.05))
        trips_s, own_s = drive.round_trips_s()
    assert min(trips_s) >= 0.1
    assert statistics.median(own_s) < statistics.median(before_s) + 0.1 + 0.03


@pytest.mark.parametrize("protocol", ["tcp", "udp"])
def test_a_stall_within_the_lease_ends_in_a_burst_of_old_commands(protocol: str) -> None:
    """The age check of the command gate exists for this case."""
    length_s = 0.6 * LEASE_S
    with driving(protocol) as drive:
        first, began_s = len(drive.sent_s), time.monotonic()
        drive.simulator.stall(length_s)
        drive.send_for(0.5 * length_s)
        arrived = drive.arrive()
        assert [number for number, _ in arrived] == list(range(first, first + len(arrived)))
        assert min(drive.sent_s[number] + age_s for number, age_s in arrived) >= began_s + length_s


@pytest.mark.parametrize("protocol", ["tcp", "udp"])
def test_a_stall_beyond_the_lease_ends_the_session_and_a_new_one_starts_fresh(
    protocol: str,
) -> None:
    with driving(protocol) as drive:
        with WithheldTime() as withheld:
            began_s = time.monotonic()
            drive.simulator.stall(2.0 * LEASE_S)
            drive.send_for(2.0 * LEASE_S)
            arrived = drive.arrive()
        assert drive.sent_s[arrived[0][0]] > began_s + 0.5 * LEASE_S
        assert max(age_s for _, age_s in arrived) < 0.5 * LEASE_S + withheld.total_s


def test_a_cut_over_tcp_within_the_lease_ends_with_the_next_retransmission() -> None:
    length_s = 0.35 * LEASE_S
    with driving("tcp") as drive:
        first = len(drive.sent_s)
        drive.simulator.cut()
        drive.send_for(length_s)
        assert drive.received.empty()
        drive.simulator.restore()
        arrived = drive.arrive()
        assert [number for number, _ in arrived] == list(range(first, first + len(arrived)))
        assert arrived[0][1] >= 0.6 - 0.001  # 0.2 s, then 0.4 s.


def test_losses_over_udp_are_losses_of_commands() -> None:
    loss, count = 0.2, 200
    with driving("udp") as drive:
        before = drive.simulator.up
        drive.simulator.set(LinkSpec(loss=loss))
        first = len(drive.sent_s)
        for _ in range(count):
            drive.send()
            time.sleep(0.001)
        drive.simulator.set(LinkSpec())
        numbers = [number for number, _ in drive.arrive() if number < first + count]
        lost = drive.simulator.up.lost - before.lost
    missing = count - len(numbers)
    assert numbers == sorted(set(numbers))
    assert missing == pytest.approx(count * loss, abs=5.0 * math.sqrt(count * loss * (1 - loss)))
    assert 0 <= lost - missing <= 20  # Some losses were only keep-alives.


def test_losses_over_tcp_lose_no_command() -> None:
    count = 100
    with driving("tcp") as drive:
        drive.simulator.set(LinkSpec(loss=0.05))
        first = len(drive.sent_s)
        for _ in range(count):
            drive.send()
            time.sleep(0.005)
        drive.simulator.set(LinkSpec())
        numbers = [number for number, _ in drive.arrive()]
    assert numbers[:count] == list(range(first, first + count))


def test_a_session_opens_over_the_slowest_link_that_a_lease_allows() -> None:
    """The maximum command age is 1.0 s; the handshake takes three round trips."""
    link = LinkSpec.parse("delay=450ms")
    with (
        Bus(node_config(["tcp/127.0.0.1:0"])) as robot,
        LinkEmulator(link, "tcp/127.0.0.1:0", robot.endpoints()[0]) as simulator,
        Bus(client_config([simulator.endpoint])) as client,
    ):
        assert client.wait_for_peer(PATIENCE_S)
