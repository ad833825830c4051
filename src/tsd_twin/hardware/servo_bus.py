"""Servos of Protocol 2.0 directly at the PC, through an adapter such as a U2D2."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tsd_twin.authority import Mandate
from tsd_twin.hardware.calibration import Calibration
from tsd_twin.hardware.errors import HardwareError
from tsd_twin.hardware.health import LinkHealth
from tsd_twin.hardware.joints import Joints
from tsd_twin.hardware.line import Line
from tsd_twin.hardware.order import Order
from tsd_twin.wire import mx64, protocol1, protocol2
from tsd_twin.wire.mx64 import Present
from tsd_twin.wire.packet import ALERT, Status

BAUD = 1_000_000
ALIVE_S = 0.05
"""A servo that answered within this counts as alive, as it does for the board."""
_ANSWER_S = 0.02
_TRY_S = 0.1
"""Patience while they are set up."""
_TRIES = 3
_WATCHDOG = 10
"""200 ms: less than the board gives the speed controllers."""
_FEED_S = 0.5
"""A watchdog that has run out, after a pause of this program, is set again within this."""


@dataclass(frozen=True, slots=True)
class ServoNews:
    """What the servos said last, by their index from 0 on."""

    present: Mapping[int, Present]
    heard_s: Mapping[int, float]
    faults: int
    """Mask of those that report a hardware error."""
    newest_s: float

    def alive(self, now_s: float) -> int:
        """Return a mask of those that answered lately."""
        return sum(1 << i for i, at_s in self.heard_s.items() if now_s - at_s <= ALIVE_S)


class ServoBus:
    """The device of a `Keeper`. `order` is written, and `news` and `gone` read, by other threads.

    Servo i + 1 is gimbal i. When this program dies, the servos stop where they are: what ends the
    motion of the robot is the board, which shuts off the wheels.
    """

    name = "the servo bus"
    baud = BAUD

    def __init__(self, joints: Joints, calibration: Calibration) -> None:
        self.health = LinkHealth("the serial line of the servos")
        self.order = Order(np.zeros(joints.count), Mandate(False, 0), 0.0)
        self.news: ServoNews | None = None
        self.gone = ""
        """Why there is no news; else empty."""
        self._joints = joints
        self._ids = range(1, len(joints.names) + 1)
        self._neutral = calibration.neutral(joints.names)
        self._signs = calibration.signs(joints.names)
        self._rest = np.zeros(joints.count)
        self._fed_s = 0.0

    def connect(self, line: Line) -> None:
        """See that all servos are there, and set up those that are not yet.

        Raises:
            HardwareError: one does not answer, or speaks Protocol 1.0; the text names it.
        """
        for device in self._ids:
            self._find(line, device)
            self._set_up(line, device)
        self._fed_s = 0.0
        self.gone = ""

    def cycle(self, line: Line) -> bool:
        """Write goals and read what is measured, both in one go; return whether all answered.

        Raises:
            HardwareError: the port is gone.
        """
        began_s, broken = time.monotonic(), line.broken
        order = self.order
        request = b""
        if began_s - self._fed_s > _FEED_S:
            self._fed_s = began_s
            request += self._all(mx64.BUS_WATCHDOG, [b"\x00"] * len(self._ids))
            request += self._all(mx64.BUS_WATCHDOG, [bytes([_WATCHDOG])] * len(self._ids))
        request += self._goals(order.setpoint if order.in_force(began_s) else self._rest)
        request += protocol2.sync_read(self._ids, mx64.PRESENT, mx64.PRESENT_SIZE)
        answers = line.ask(request, len(self._ids), _ANSWER_S)
        now_s = time.monotonic()
        self._take(answers, now_s)
        self.health.noise.note(line.broken > broken, now_s)
        if len(answers) < len(self._ids):
            self.health.miss()
        else:
            self.health.note(now_s - began_s)
        return bool(answers)

    def lose(self, reason: str) -> None:
        """Take note that the adapter is gone."""
        self.news, self.gone = None, reason
        self.health.reconnects += 1

    def leave(self, line: Line) -> None:
        """Send the gimbals to neutral, which they keep."""
        off = self._all(mx64.BUS_WATCHDOG, [b"\x00"] * len(self._ids))
        line.ask(off + self._goals(self._rest), 0, 0.0)

    def measured(self, news: ServoNews) -> list[int]:
        """Return steps from neutral, as the joints are drawn; 0 where nothing was measured."""
        return [
            sign * (news.present[i].position - neutral) if i in news.present else 0
            for i, (sign, neutral) in enumerate(zip(self._signs, self._neutral, strict=True))
        ]

    def _take(self, answers: list[Status], now_s: float) -> None:
        before = self.news or ServoNews({}, {}, 0, now_s)
        whole = [a for a in answers if a.id in self._ids and len(a.data) == mx64.PRESENT_SIZE]
        if whole:
            faults = before.faults
            for answer in whole:
                bit = 1 << answer.id - 1
                faults = faults | bit if answer.error & ALERT else faults & ~bit
            present = {a.id - 1: Present.unpack(a.data) for a in whole}
            heard_s = dict.fromkeys(present, now_s)
            self.news = ServoNews(
                {**before.present, **present}, {**before.heard_s, **heard_s}, faults, now_s
            )

    def _goals(self, setpoint: np.ndarray) -> bytes:
        goals = self._joints.goals(setpoint)
        steps = [
            mx64.GOAL.pack(neutral + sign * goal)
            for neutral, sign, goal in zip(self._neutral, self._signs, goals, strict=True)
        ]
        return self._all(mx64.GOAL_POSITION, steps)

    def _all(self, address: int, data: list[bytes]) -> bytes:
        return protocol2.sync_write(address, dict(zip(self._ids, data, strict=True)))

    def _find(self, line: Line, device: int) -> None:
        for _ in range(_TRIES):
            if line.ask(protocol2.ping(device), 1, _TRY_S):
                return
        servo = self._joints.named(1 << device - 1)
        if line.ask(protocol1.ping(device), 1, _TRY_S, protocol1):
            raise HardwareError(
                f"{servo} speaks Protocol 1.0: bring its firmware to 2.0 with the recovery of "
                "Dynamixel Wizard 2.0, or connect the servos to the board, which speaks both"
            )
        raise HardwareError(
            f"{servo} does not answer at {line.name} at {self.baud} Bd: "
            "has it power, this id and this rate?"
        )

    def _set_up(self, line: Line, device: int) -> None:
        wanted = {mx64.OPERATING_MODE: mx64.POSITION_MODE, mx64.RETURN_DELAY: 0}
        other = {
            address: value
            for address, value in wanted.items()
            if self._ask(line, device, protocol2.read(device, address, 1)).data != bytes([value])
        }
        if other:  # Only then: a servo without torque lets go of its gimbal.
            self._write(line, device, mx64.TORQUE_ENABLE, 0)
            for address, value in other.items():
                self._write(line, device, address, value)
        self._write(line, device, mx64.BUS_WATCHDOG, 0)
        self._write(line, device, mx64.TORQUE_ENABLE, 1)

    def _write(self, line: Line, device: int, address: int, value: int) -> None:
        self._ask(line, device, protocol2.write(device, address, bytes([value])))

    def _ask(self, line: Line, device: int, request: bytes) -> Status:
        for _ in range(_TRIES):
            for answer in line.ask(request, 1, _TRY_S):
                if answer.error & ~ALERT:
                    raise HardwareError(
                        f"{self._joints.named(1 << device - 1)} refuses its set-up: "
                        f"error {answer.error & ~ALERT}"
                    )
                return answer
        raise HardwareError(f"{self._joints.named(1 << device - 1)} fell silent")
