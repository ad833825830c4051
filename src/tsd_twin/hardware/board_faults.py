"""Fault messages for telemetry of the controller board, naming servo and channel."""

from __future__ import annotations

from tsd_twin.dynamixel.blocks import Telemetry
from tsd_twin.dynamixel.control_table import SWITCH_US, BoardMode, RcChannel, Refusal, Trip
from tsd_twin.dynamixel.servo_models import wrong_setting
from tsd_twin.hardware.controller_board import REFUSALS, TRIPS
from tsd_twin.hardware.joints import FAR, NO_TORQUE, TOO_HOT, JointConverter, hot_servos


class BoardFaults:
    """Converts telemetry to fault messages, for a robot with these joints."""

    def __init__(
        self, joints: JointConverter, expected: int, *, arm_mv: int, receiver_expected: bool
    ) -> None:
        """`expected` is the mask of servos that must be connected to the board."""
        self._joints = joints
        self._expected = expected
        self._arm_mv = arm_mv
        self._receiver_expected = receiver_expected

    def fault(self, board: Telemetry, lost: str) -> str:
        """Return the fault reported by the board, or "".

        `lost` is the reason why the board is disarmed although it should be armed.
        """
        if board.mode == BoardMode.RC:
            return "the radio control has the robot"
        if servos := self._servo_fault(board):
            return servos
        if lost:
            return f"{self._stuck(board)}{lost}"
        if unread := self._expected & ~board.servo_checked:
            return f"{self._joints.named(unread)}: the settings have not been read yet"
        return self._arming_obstacle(board)

    def _arming_obstacle(self, board: Telemetry) -> str:
        """Return the reason why the board would not arm, apart from its servos, or ""."""
        if not board.drive_on:
            return REFUSALS[Refusal.DRIVE]
        if not board.stop_proven:
            return REFUSALS[Refusal.STOP_NOT_PROVEN]
        if board.mode != BoardMode.ARMED and board.battery_mv < self._arm_mv:
            return f"the battery is too low to arm: {board.battery_mv / 1000.0:.1f} V"
        if board.mode != BoardMode.ARMED and not board.esc_ready:
            return "the speed controllers have not had zero throttle for 2 s yet"
        missing = [RcChannel(i).name.lower() for i, us in enumerate(board.rc) if not us]
        if missing and (self._receiver_expected or len(missing) < len(board.rc)):
            return f"{REFUSALS[Refusal.RECEIVER]}: no pulses of {', '.join(missing)}"
        if 0 < board.rc[RcChannel.KILL] <= SWITCH_US:
            return REFUSALS[Refusal.KILL]
        manual = board.rc[RcChannel.MANUAL] > SWITCH_US
        return "the radio control is switched to manual" if manual else ""

    def _servo_fault(self, board: Telemetry) -> str:
        """Return the servo fault reported by the board, or ""."""
        if dead := self._expected & ~board.servo_alive:
            return self._joints.silent(dead)
        if broken := self._expected & board.servo_fault:
            return f"{self._joints.named(broken)}: hardware error"
        if self._expected & 1 << board.wrong_servo >> 1:
            return self._wrong_setting(board)
        if hot := self._expected & hot_servos(dict(enumerate(board.temperature))):
            return f"{self._joints.named(hot)}: {TOO_HOT}"
        if far := self._expected & board.servo_far:
            return f"{self._joints.named(far)}: {FAR}"
        if limp := self._expected & board.servo_checked & ~board.servo_torque:
            return f"{self._joints.named(limp)}: {NO_TORQUE}"
        return ""

    def last_trip(self, board: Telemetry) -> str:
        """Return the reason of the last trip, with the affected servos."""
        if not board.trip:
            return "none"
        return f"{self._stuck(board)}{TRIPS.get(board.trip, f'trip {board.trip}')}"

    def _stuck(self, board: Telemetry) -> str:
        stuck = board.servo_stuck if board.trip == Trip.FOLLOWING else 0
        return f"{self._joints.named(stuck)}: " if stuck else ""

    def _wrong_setting(self, board: Telemetry) -> str:
        servo = board.wrong_servo - 1
        named, model = self._joints.named(1 << servo), board.servo_model[servo]
        return wrong_setting(named, model, board.wrong_register, board.wrong_value)
