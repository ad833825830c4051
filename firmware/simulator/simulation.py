# SPDX-License-Identifier: GPL-3.0-or-later
"""The whole robot in virtual time: board, servos, motors, receiver, battery."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from firmware.simulator import board as boards
from firmware.simulator.mx64 import Mx64
from firmware.simulator.plant import RobotPlant
from firmware.simulator.power import PowerSimulation
from firmware.simulator.servo_bus import ServoBusSimulation
from tsd_twin.dynamixel.control_table import ADDRESS
from tsd_twin.robots import SingularityDescription, description_of_kind, load_robot

NEUTRAL = (2048,) * 6
STRAIGHT = (False,) * 6
_STEP_S = 0.004
"""The robot moves on at least this often, while there is traffic on the bus."""
_STICK_US, _SPEED_US = 400, 800
_ZERO_US = 1001.0
_DIVIDER = 4.0


class FirmwareSimulation:
    """Simulated robot that is controlled by the compiled firmware.

    `version` is the protocol of all servos, or one for each; `receiver` says whether there is one,
    with its kill switch at "run" and its manual switch at "PC".
    """

    def __init__(
        self,
        version: int | Sequence[int] = 2,
        *,
        receiver: bool = False,
        elf: Path | None = None,
        neutral: Sequence[int] = NEUTRAL,
        reverse: Sequence[bool] = STRAIGHT,
    ) -> None:
        elf = boards.build() if elf is None else elf
        self.table_address = boards.symbol(elf, "table")
        self.board = boards.Board(elf, self.table_address + ADDRESS["mode"])
        versions = [version] * 6 if isinstance(version, int) else version
        self.servos = [Mx64(i + 1, versions[i]) for i in range(6)]
        self.servo_bus = ServoBusSimulation(self.servos)
        self.plant = RobotPlant(
            description_of_kind(load_robot("tsd"), SingularityDescription), neutral, reverse
        )
        self.power = PowerSimulation()
        self._moved_s = 0.0
        self._receiver = [1500, 1500, 1500, 1100, 1900, 1100]
        self.board.on_request(self._on_request)
        self.set_battery(12.0)
        if receiver:
            self.board.set_receiver(self._receiver)

    def close(self) -> None:
        """Free it."""
        self.board.close()

    def run(self, seconds: float) -> None:
        """Let time pass."""
        self.board.run(seconds)
        self._move()

    def pulses_us(self) -> list[float]:
        """Widths of the pulses to the speed controllers."""
        return [self.board.pulse(i).us for i in range(3)]

    def set_battery(self, volts: float) -> None:
        """Set the battery voltage."""
        self.power.battery_v = volts
        self._put_voltages()
        for servo in self.servos:
            servo.volts = volts

    def set_contactor(self, *, closed: bool) -> None:
        """Close the contactor of the drive, or open it as either stop does."""
        self._move()
        self.power.contactor = closed

    def set_sticks(self, forward: float, left: float, turn: float, speed: float) -> None:
        """Move the sticks of the radio control, from -1 to 1; `speed` from 0 to 1."""
        sticks = [1500 + round(_STICK_US * share) for share in (forward, left, turn)]
        self._receiver[:4] = [*sticks, 1100 + round(_SPEED_US * speed)]
        self.board.set_receiver(self._receiver)

    def set_switches(self, *, kill: bool = False, manual: bool = False) -> None:
        """Set the switches of the radio control."""
        self._receiver[4:] = [1100 if kill else 1900, 1900 if manual else 1100]
        self.board.set_receiver(self._receiver)

    def lose_receiver(self, *channels: int) -> None:
        """Stop the pulses of some receiver channels; of all when none is named."""
        lost = channels or range(6)
        self.board.set_receiver([0 if i in lost else us for i, us in enumerate(self._receiver)])

    def _on_request(self, request: bytes) -> None:
        answer = self.servo_bus.answer(request)
        if answer is None or self.board.now_s - self._moved_s > _STEP_S:
            self._move()
        if answer is not None:
            self.board.reply(*answer)

    def _move(self) -> None:
        pulses_us, power = self.pulses_us(), self.power
        power.advance(self.board.now_s - self._moved_s, throttle=max(pulses_us) > _ZERO_US)
        self._moved_s = self.board.now_s
        self._put_voltages()
        self.plant.follow(self._moved_s, self.servos, pulses_us, driven=power.driven)

    def _put_voltages(self) -> None:
        self.board.set_adc(0, self.power.battery_v / _DIVIDER)
        self.board.set_adc(1, self.power.drive_v / _DIVIDER)
