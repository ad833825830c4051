"""The controller board at the other end of a line: one WRITE and one READ in each cycle."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass

import numpy as np

from tsd_twin.authority import Mandate
from tsd_twin.hardware.arm_switch import ArmSwitch
from tsd_twin.hardware.calibration import CENTRE, Calibration
from tsd_twin.hardware.health import LinkHealth
from tsd_twin.hardware.joints import Joints, padded
from tsd_twin.hardware.line import Line
from tsd_twin.hardware.meeting import READ, REST, SETTLE_S, meet
from tsd_twin.hardware.order import Order
from tsd_twin.wire import protocol2
from tsd_twin.wire.blocks import Command, Setup, Telemetry
from tsd_twin.wire.packet import Status
from tsd_twin.wire.table import BOARD_ID, ESCS, SERVOS, ZERO_THROTTLE

_LOG = logging.getLogger(__name__)
BAUD = 1_000_000
ANSWER_S = 0.04
"""Patience with an answer in a cycle: two that are lost are not yet `SILENT_S`."""
_LEAVING = 5


@dataclass(frozen=True, slots=True)
class News:
    """What the board said last."""

    telemetry: Telemetry
    heard_s: float
    lost: str
    """Why it is not armed although it should be; else empty."""


class Board:
    """The device of a `Keeper`. `order` is written, and `news` and `gone` read, by other threads.

    Each of them is replaced as a whole, so nobody sees a half.
    """

    name = "the controller board"

    def __init__(
        self, joints: Joints, calibration: Calibration, *, servos: bool = True, baud: int = BAUD
    ) -> None:
        """Speak for a board that drives the servos as well, or only the speed controllers."""
        self.baud = baud
        self.health = LinkHealth("the serial line")
        self.order = Order(np.zeros(joints.count), Mandate(False, 0), 0.0)
        self.news: News | None = None
        self.gone = ""
        """Why there is no news; else empty."""
        self._joints = joints
        self._servos = servos
        self._switch = ArmSwitch()
        reverse = [sign < 0 for sign in calibration.signs(joints.names)]
        self._setup = Setup(
            padded(calibration.neutral(joints.names), SERVOS, CENTRE),
            sum(1 << i for i, turned in enumerate(reverse) if turned),
            joints.goal_limit,
            joints.servos if servos else 0,
        )

    def connect(self, line: Line) -> None:
        """See whether it is a board of ours with a table that we know, and set it up.

        Raises:
            HardwareError: it is not, or does not answer.
        """
        said = meet(line, self._setup, self.baud)
        self.news = News(said, time.monotonic(), self._switch.lost)
        self.gone = ""

    def cycle(self, line: Line) -> bool:
        """Write what shall be and read what is, both in one go; return whether it answered.

        The echo of the heartbeat shows that the answer is one to this very question.

        Raises:
            HardwareError: the port is gone, or the board has restarted and is no longer ours.
        """
        began_s = time.monotonic()
        before, broken = self.news, line.broken
        command = self._command(self.order, began_s)
        request = protocol2.write(BOARD_ID, Command.ADDRESS, command.pack()) + READ
        answers = line.ask(request, 2, ANSWER_S)
        now_s = time.monotonic()
        telemetry, spoilt = _telemetry(answers), line.broken > broken
        if telemetry is None or telemetry.beat != command.heartbeat:
            self.health.miss()
            self._note(spoilt, now_s)
            # The answers to an older question: all later ones would be late as well.
            if answers and not spoilt:
                line.drain(SETTLE_S)
            return False
        self.health.note(now_s - began_s)
        if before is not None and _restarted(before.telemetry, telemetry):
            _LOG.warning("the controller board has restarted")
            self._switch.lose("the controller board has restarted")
            self.connect(line)
        elif before is not None:
            spoilt = spoilt or _misheard(before.telemetry, telemetry)
        self._note(spoilt, now_s)
        self._switch.note(telemetry)
        self.news = News(telemetry, now_s, self._switch.lost)
        return True

    def lose(self, reason: str) -> None:
        """Take note that it is gone: it will come back disarmed, and stays so."""
        self._switch.lose("the controller board was lost")
        self.news, self.gone = None, reason
        self.health.reconnects += 1

    def leave(self, line: Line) -> None:
        """Disarm it, more than once if it does not hear."""
        for _ in range(_LEAVING):
            request = protocol2.write(BOARD_ID, Command.ADDRESS, REST.pack())
            if line.ask(request, 1, ANSWER_S):
                return

    def _note(self, spoilt: bool, now_s: float) -> None:
        self.health.noise.note(spoilt, now_s)
        if self.health.noise.fault:
            self._switch.lose(self.health.noise.fault)

    def _command(self, order: Order, now_s: float) -> Command:
        if not order.in_force(now_s):
            self._switch.lose("the robot node hangs")
            return REST
        arm = self._switch.turn(order.mandate.armed)
        goals = self._joints.goals(order.setpoint) if self._servos else ()
        return Command(
            heartbeat=order.mandate.words & 0xFFFF,
            arm=arm,
            throttle=padded(self._joints.throttles(order.setpoint), ESCS, ZERO_THROTTLE),
            goal=padded(goals, SERVOS, 0),
        )


def _telemetry(answers: list[Status]) -> Telemetry | None:
    """Return what was read, if the answers are those to a write and a read."""
    if [len(answer.data) for answer in answers] != [0, Telemetry.LAYOUT.size]:
        return None
    return Telemetry.unpack(answers[1].data)


def _restarted(before: Telemetry, after: Telemetry) -> bool:
    """Return whether there was a reset in between; after 50 days the clock begins again."""
    back_ms = before.millis - after.millis
    return after.resets != before.resets or 0 < back_ms < 1 << 31


def _misheard(before: Telemetry, after: Telemetry) -> bool:
    """Return whether the board has heard something broken in between."""
    return (before.crc_errors, before.rx_errors) != (after.crc_errors, after.rx_errors)
