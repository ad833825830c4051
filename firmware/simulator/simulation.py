# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole robot in virtual time: board, servos, motors, receiver, battery."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from firmware.simulator import board as boards
from firmware.simulator.esc_telemetry import PERIOD_S, EscTelemetry
from firmware.simulator.mx64 import Mx64
from firmware.simulator.plant import RobotPlant
from firmware.simulator.power import AS_DRAWN, SERVO_LEAST_V, PowerSimulation, Wiring
from firmware.simulator.rp2040_board import Rp2040Board
from firmware.simulator.servo_bus import ServoBusSimulation
from tsd_twin.hardware.dynamixel.control_table import ADDRESS, ResetCause
from tsd_twin.robots import SingularityDescription, description_of_kind, load_robot

NEUTRAL = (2048,) * 6
IDS = (1, 2, 3, 4, 5, 6)
STRAIGHT = (False,) * 6
_STEP_S = 0.004
"""Maximum step of the robot while there is traffic on the bus."""
_STICK_US, _SPEED_US = 400, 800
_TICK_S = 1e-7
_STARTED_S = 0.05
"""Delay after the board's start until the contactor, open at power-on, is closed."""
_DIVIDER = 4.0


class FirmwareSimulation:
    """Simulated robot controlled by the compiled firmware.

    Args:
        version: Protocol of all servos, or one per servo.
        ids: Servo ids.
        receiver: Whether a receiver is connected, with its switches at "run" and "PC".
        sbus: Whether the receiver sends SBUS frames.
        elf: Firmware; built if None.
        neutral: Servo positions at neutral, steps.
        reverse: Reversed servos.
        wiring: Wiring of the power supply.
        wheel_pulses: Pulses of the wheel sensors per turn; 0 without sensors.
        pole_pairs: Pole pairs of the motors whose speed controllers send telemetry; 0 without.
    """

    def __init__(
        self,
        version: int | Sequence[int] = 2,
        *,
        ids: Sequence[int] = IDS,
        receiver: bool = False,
        sbus: bool = False,
        elf: Path | None = None,
        neutral: Sequence[int] = NEUTRAL,
        reverse: Sequence[bool] = STRAIGHT,
        wiring: Wiring = AS_DRAWN,
        wheel_pulses: int = 0,
        pole_pairs: int = 0,
    ) -> None:
        elf = boards.build() if elf is None else elf
        self.table_address = boards.table_address(elf)
        kind = Rp2040Board if elf.suffix == ".bin" else boards.Board
        self.board = kind(elf, self.table_address + ADDRESS["mode"])
        versions = [version] * 6 if isinstance(version, int) else version
        self.servos = [Mx64(ids[i], versions[i]) for i in range(6)]
        self.servo_bus = ServoBusSimulation(self.servos)
        self.plant = RobotPlant(
            description_of_kind(load_robot("tsd"), SingularityDescription), neutral, reverse
        )
        self.power = PowerSimulation(wiring)
        self.wheel_pulses = wheel_pulses
        self.telemetry = [
            EscTelemetry(pole_pairs, i * PERIOD_S / 7.0) for i in range(3 if pole_pairs else 0)
        ]
        self.sensor_wheels: list[int | None] = [0, 1, 2]
        """Wheel at each sensor or telemetry input; None if it is disconnected."""
        self.inputs_v: dict[int, float | None] = {}
        """Overrides of the analogue input voltages; None disconnects an input (native library
        only).
        """
        self._starts_s: float | None = None
        """Start time of a board that is off: after its boot loader, or a brown-out."""
        self._start_cause = ResetCause.POWER_ON
        self._has_power = True
        self._closes_s: float | None = None
        self._moved_s = 0.0
        self.receiver_us = [1500, 1500, 1500, 1100, 1900, 1100]
        self.board.on_request(self._on_request)
        self.set_battery(12.0)
        self.sbus = sbus
        self.board.send_frames(on=sbus)
        if receiver:
            self.board.set_receiver(self.receiver_us)
        self._open_at_first()

    def close(self) -> None:
        """Free the board."""
        self.board.close()

    def run(self, seconds: float) -> None:
        """Let time pass."""
        end_s = self.board.now_s + seconds
        while (left_s := end_s - self.board.now_s) > _TICK_S:
            if self._starts_s is not None or not self._has_power:
                left_s = min(left_s, _STEP_S)  # No bus traffic advances the robot in this state.
            if self._closes_s is not None:
                left_s = min(left_s, max(self._closes_s - self.board.now_s, _TICK_S))
            self.board.run(left_s)
            self._move()
            if self._closes_s is not None and self.board.now_s >= self._closes_s - _TICK_S:
                self.set_contactor(closed=True)
            if self._starts_s is not None and self.board.now_s >= self._starts_s:
                self._starts_s = None
                power_on = self._start_cause == ResetCause.POWER_ON
                self.board.on(self._start_cause, lose_memory=power_on)

    def pulses_us(self) -> list[float]:
        """Return the pulse widths to the speed controllers."""
        return [self.board.pulse_us(i) for i in range(3)]

    def set_battery(self, volts: float) -> None:
        """Set the battery voltage."""
        self._move()
        self.power.battery_v = volts
        self._switch()

    def set_contactor(self, *, closed: bool) -> None:
        """Close the contactor of the drive, or open it like either stop switch."""
        self._move()
        self._closes_s = None
        self.power.stop_circuit = closed

    def set_servo_fuse(self, *, whole: bool) -> None:
        """Blow or replace the fuse of the servos and the circuits behind it."""
        self._move()
        self.power.servo_fuse = whole
        self._switch()

    def set_usb(self, *, plugged: bool) -> None:
        """Switch the PC's 5 V on or off; the caller handles the data."""
        self._move()
        self.power.usb = plugged
        self._switch()

    def open_port(self) -> None:
        """Simulate the effect of a program opening the port."""
        if self.power.wiring.auto_reset and self._has_power:
            self.reset()

    def reset(self) -> None:
        """Reset the board by its pin."""
        self._start(ResetCause.EXTERNAL, self.power.wiring.boot_loader_s)

    def power_cycle(self) -> None:
        """Interrupt the board's power briefly."""
        self.board.reset(power=True)
        self._open_at_first()

    def brown_out(self, seconds: float) -> None:
        """Keep the board's supply too low for `seconds`."""
        self._start(ResetCause.BROWN_OUT, seconds + self.power.wiring.boot_loader_s)

    def set_sticks(self, forward: float, left: float, turn: float, speed: float) -> None:
        """Set the sticks of the radio control, -1 to 1; `speed` 0 to 1."""
        sticks = [1500 + round(_STICK_US * share) for share in (forward, left, turn)]
        self.receiver_us[:4] = [*sticks, 1100 + round(_SPEED_US * speed)]
        self.board.set_receiver(self.receiver_us)

    def set_switches(self, *, kill: bool = False, manual: bool = False) -> None:
        """Set the switches of the radio control."""
        self.receiver_us[4:] = [1100 if kill else 1900, 1900 if manual else 1100]
        self.board.set_receiver(self.receiver_us)

    def lose_receiver(self, *channels: int) -> None:
        """Stop the pulses of some receiver channels, or of all."""
        lost = channels or range(6)
        self.board.set_receiver([0 if i in lost else us for i, us in enumerate(self.receiver_us)])

    def set_signal(self, *, lost: bool) -> None:
        """Remove or restore the transmitter's signal at an SBUS receiver."""
        self.board.send_frames(on=self.sbus, flags=0x0C if lost else 0)

    def _on_request(self, request: bytes) -> None:
        answer = self.servo_bus.answer(request)
        if answer is None or self.board.now_s - self._moved_s > _STEP_S:
            self._move()
        if answer is not None:
            self.board.reply(*answer)

    def _move(self) -> None:
        pulses_us, power = self.pulses_us(), self.power
        power.advance(self.board.now_s - self._moved_s, throttle=self.plant.driven)
        self._moved_s = self.board.now_s
        self._put_voltages()
        self.plant.follow(self._moved_s, self.servos, pulses_us, power)
        if self.wheel_pulses:
            hz = self.wheel_pulses * self.plant.wheel_speeds / (2.0 * math.pi)
            for sensor, wheel in enumerate(self.sensor_wheels):
                self.board.set_wheel(sensor, 0.0 if wheel is None else float(hz[wheel]))
        volts = power.drive_v if power.driven else 0.0
        for wheel, esc in enumerate(self.telemetry):
            sent = esc.due(self._moved_s, float(self.plant.wheel_speeds[wheel]), volts)
            for sensor in (
                i for i, wired in enumerate(self.sensor_wheels) if sent and wired == wheel
            ):
                self.board.send_telemetry(sensor, sent)

    def _switch(self) -> None:
        """Update the power state of servos and board."""
        self._put_voltages()
        for servo in self.servos:
            servo.set_power(self.power.servo_v, SERVO_LEAST_V)
        if self.power.board == self._has_power:
            return
        self._has_power = self.power.board
        self._starts_s = None
        if self._has_power:
            self._start(ResetCause.POWER_ON, self.power.wiring.boot_loader_s)
        else:
            self.board.off()

    def _start(self, cause: ResetCause, after_s: float) -> None:
        self.board.off()
        self._start_cause, self._starts_s = cause, self.board.now_s + after_s
        if cause == ResetCause.POWER_ON:
            self._open_at_first(after_s)
        if after_s <= 0.0:
            self._starts_s = None
            self.board.on(cause, lose_memory=cause == ResetCause.POWER_ON)

    def _open_at_first(self, after_s: float = 0.0) -> None:
        """Open the contactor as without power, until it is closed manually."""
        self._move()
        self.power.stop_circuit, self.power.drive_v = False, 0.0
        self._closes_s = self.board.now_s + after_s + _STARTED_S
        self._put_voltages()

    def _put_voltages(self) -> None:
        for channel, volts in enumerate((self.power.battery_v, self.power.drive_v)):
            input_v = self.inputs_v.get(channel, volts / _DIVIDER)
            if input_v is None:
                self.board.cut_adc(channel)
            else:
                self.board.set_adc(channel, input_v)
