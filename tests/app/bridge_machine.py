"""Compiled firmware behind a pty, the bridge in front of it, and an operator on the bus."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from tests.support.bus_operator import BusOperator
from tests.support.programs import Program
from tests.support.robot_node import RunningNode
from tests.support.withheld import PATIENCE_S, own_threads_to_realtime
from tsd_twin import robots
from tsd_twin.bus import Bus, client_config
from tsd_twin.messages.topics import Service
from tsd_twin.robots import RobotDescription

AHEAD = (0.5, 0.0, 0.0)
ZERO_US = 1000.0
QUICK = robots.read_description("tsd").replace("[motor]", "[motor]\narming_hold_s = 0.1", 1)
"""The shipped robot without the core's wait, as the board also waits."""


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Endpoint of a node, for an operator."""

    id: str
    endpoint: str
    robot: RobotDescription

    def client(self) -> Bus:
        """Return a session that is linked to it."""
        bus = Bus(client_config([self.endpoint]))
        assert bus.wait_for_peer(PATIENCE_S)
        return bus


class Box:
    """Process of the firmware simulator; `port` stays the same when unplugged."""

    def __init__(self, program: Program, port: str) -> None:
        self.program, self.port = program, port
        program.ready()

    def tell(self, command: str) -> None:
        """Send a fault command."""
        stdin = self.program.process.stdin
        assert stdin is not None
        stdin.write(command + "\n")
        stdin.flush()

    def show(self) -> dict[str, Any]:
        """Return pose and actuator commands, measured at the pins."""
        count = len(self.program.output)
        self.tell("show")
        wait_until(lambda: len(self.program.output) > count, "an answer of the box")
        return json.loads(self.program.output[count])

    @property
    def shut_off(self) -> bool:
        """Zero throttle at all pins."""
        return all(abs(pulse - ZERO_US) < 1.0 for pulse in self.show()["pulses_us"])

    @property
    def at_rest(self) -> bool:
        """Zero throttle at all pins, and neutral goals at all servos."""
        return self.shut_off and all(goal == 2048 for goal in self.show()["goals"])

    @property
    def drives(self) -> bool:
        """Throttle at all pins, and tilted goals."""
        seen = self.show()
        return min(seen["pulses_us"]) > 1100.0 and any(goal != 2048 for goal in seen["goals"])


class Machine:
    """Simulated board, bridge, and an operator."""

    def __init__(
        self,
        start: Callable[..., Program],
        folder: Path,
        wheel_pulses: int = 0,
        described_pulses: int = 0,
    ) -> None:
        """`described_pulses`: pulses per turn in the robot file, if they differ."""
        self._start, self._folder = start, folder
        self.description = folder / "quick.toml"
        described = described_pulses or wheel_pulses
        sensors = f"\n[wheel_sensor]\npulses_per_turn = {described}\n" if described else ""
        # The board counts at most 1,000 pulses per second, also at the fastest speed.
        limited = QUICK.replace("[drive]", "[drive]\nmax_speed_rpm = 10000.0", 1)
        self.description.write_text((limited if described_pulses else QUICK) + sensors)
        port = str(folder / "port")
        pulses = ("--wheel-pulses", str(wheel_pulses))
        self.box = Box(start("firmware.simulator", "--link", port, *pulses), port)
        self.bridge = self.start_bridge()
        self.pilot = self._pilot()

    def start_bridge(self, port: str | None = None, *more: str) -> Program:
        """Start a bridge at the box, or at another port."""
        return self._start(
            "tsd_bridge",
            *("--port", port or self.box.port),
            *("--robot", str(self.description)),
            *("--listen", "tcp/127.0.0.1:0"),
            *more,
        )

    def restart_bridge(self, port: str | None = None, *more: str) -> None:
        """Replace the bridge, and connect the operator to the new one."""
        if self.bridge.process.poll() is None:
            self.bridge.end()
        self.pilot.bus.close()
        self.bridge = self.start_bridge(port, *more)
        self.pilot = self._pilot()

    def _pilot(self) -> BusOperator:
        self.endpoint = self.bridge.ready().split()[-1]
        endpoint = Endpoint("tsd", self.endpoint, robots.load_robot("tsd"))
        pilot = BusOperator.blind(cast(RunningNode, endpoint))
        own_threads_to_realtime()  # Those of the operator, and not a browser that starts later.
        return pilot

    @property
    def mode(self) -> str:
        return self.pilot.status.mode

    @property
    def _holds(self) -> bool:
        return self.pilot.status.lease.holder == self.pilot.name

    @property
    def reason(self) -> str:
        return self.pilot.status.stop_reason

    @property
    def hardware(self) -> dict[str, Any]:
        return dict(self.pilot.status.hardware)

    @property
    def answers(self) -> bool:
        """Whether its board has answered recently."""
        return self.hardware["connected"] and self.hardware["age_ms"] < 50.0

    def get_ready(self) -> None:
        """Take control, reset and arm."""
        self.stand(lambda: self.mode == "ready")

    def stand(self, until: Callable[[], object]) -> None:
        """Hold the stick at its centre until a condition is true."""
        self._until(until, (0.0, 0.0, 0.0))

    def drive(self, until: Callable[[], object] | None = None) -> None:
        """Get ready, and drive until the actuators do, or something else is the case."""
        there = until or (lambda: self.box.drives)
        self.get_ready()
        self._until(lambda: self.mode == "driving" and there(), AHEAD)

    def _until(self, condition: Callable[[], object], twist: tuple[float, float, float]) -> None:
        pilot, end_s = self.pilot, time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end_s, (self.mode, self.reason, self.hardware)
            if not self._holds:
                pilot.acquire(take_over=True)
            elif self.mode in ("fault", "stopped"):
                pilot.ask(Service.RESET, lease=pilot.lease)
            elif self.mode == "disarmed":
                pilot.ask(Service.ARM, lease=pilot.lease)
            else:
                pilot.send(twist)
            time.sleep(0.02)

    def hold_until(self, condition: Callable[[], object]) -> None:
        """Hold the stick until a condition is true, like an operator who has noticed nothing."""
        self.pilot.drive(AHEAD, until=condition)

    def refuses_to_arm(self, reason: str) -> None:
        """Ask for it until it is refused for this reason, resetting what is latched."""
        pilot = self.pilot

        def refused() -> bool:
            if not self._holds:
                pilot.acquire(take_over=True)
            if self.mode in ("fault", "stopped"):
                pilot.ask(Service.RESET, lease=pilot.lease)
            reply = pilot.ask(Service.ARM, lease=pilot.lease)
            assert not reply["ok"], "it has armed"
            return reply["reason"] == reason

        wait_until(refused, f"no refusal because {reason}")

    def stays_at_rest(self, seconds: float = 0.5) -> bool:
        """Return whether nothing moves, with the stick held, for a while of the board's time."""
        start_s = self.box.show()["time_s"]
        while self.box.show()["time_s"] < start_s + seconds:
            self.pilot.send(AHEAD)
            if not self.box.at_rest:
                return False
        return True

    def close(self) -> None:
        """Disconnect the operator."""
        self.pilot.bus.close()


def wait_for_mode(machine: Machine, mode: str, *, held: bool = False) -> None:
    """Wait for a mode; any other that lasts is a failure at once."""
    lasting = {"fault", "stopped", "disarmed"} - {mode}
    end_s = time.monotonic() + PATIENCE_S
    while machine.mode != mode:
        assert machine.mode not in lasting, machine.reason
        assert time.monotonic() < end_s, machine.mode
        if held:
            machine.pilot.send(AHEAD)
        time.sleep(0.02)


def wait_until(condition: Callable[[], object], what: str) -> None:
    """Poll a condition until it is true."""
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s, what
        time.sleep(0.02)
