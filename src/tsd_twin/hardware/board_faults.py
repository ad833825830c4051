"""Faults in telemetry of the controller board, naming servo and channel."""

from __future__ import annotations

from tsd_twin.hardware.controller_board import obstacle_word, trip_word
from tsd_twin.hardware.dynamixel.control_table import (
    SWITCH_US,
    BoardMode,
    RcChannel,
    Refusal,
    Telemetry,
    Trip,
    TripHistory,
)
from tsd_twin.hardware.dynamixel.servo_models import wrong_setting
from tsd_twin.hardware.joints import JointConverter, hot_servos
from tsd_twin.messages.codes import Code, Reason, Type, because
from tsd_twin.messages.sentences import WORDS, sentence


class BoardFaults:
    """Converts telemetry to faults, for a robot with these joints."""

    def __init__(
        self, joints: JointConverter, expected: int, *, arm_mv: int, receiver_expected: bool
    ) -> None:
        """`expected` is the mask of servos that must be connected to the board."""
        self._joints = joints
        self._expected = expected
        self._arm_mv = arm_mv
        self._receiver_expected = receiver_expected

    def fault(self, board: Telemetry, lost: Reason | None) -> Reason | None:
        """Return the fault reported by the board, or None.

        `lost` is the reason why the board is disarmed although it should be armed.
        """
        if board.mode == BoardMode.RC:
            return because(Code.RADIO_CONTROL)
        if servos := self._servo_fault(board):
            return servos
        if lost:
            stuck = _stuck(board)
            return self._joints.about(stuck, Code.GIMBALS_STUCK, lost) if stuck else lost
        if unread := self._expected & ~board.servo_checked:
            return self._joints.about(unread, Code.SERVO_UNREAD)
        return self._arming_obstacle(board)

    def _arming_obstacle(self, board: Telemetry) -> Reason | None:
        """Return the reason why the board would not arm, apart from its servos, or None."""
        if not board.drive_on:
            return _obstacle(Refusal.DRIVE)
        if not board.stop_proven:
            return _obstacle(Refusal.STOP_NOT_PROVEN)
        if board.mode != BoardMode.ARMED and board.battery_mv < self._arm_mv:
            return because(Code.BATTERY_TOO_LOW, volts=board.battery_mv / 1000.0)
        if board.mode != BoardMode.ARMED and not board.esc_ready:
            return because(Code.ESCS_NOT_READY)
        missing = [RcChannel(i).name.lower() for i, us in enumerate(board.rc) if not us]
        if missing and (self._receiver_expected or len(missing) < len(board.rc)):
            return because(Code.RECEIVER_SILENT, channels=", ".join(missing))
        if 0 < board.rc[RcChannel.KILL] <= SWITCH_US:
            return _obstacle(Refusal.KILL)
        manual = board.rc[RcChannel.MANUAL] > SWITCH_US
        return because(Code.MANUAL_ON) if manual else None

    def _servo_fault(self, board: Telemetry) -> Reason | None:
        """Return the servo fault reported by the board, or None."""
        if dead := self._expected & ~board.servo_alive:
            return self._joints.silent(dead)
        if broken := self._expected & board.servo_fault:
            return self._joints.about(broken, Code.SERVO_ERROR)
        if self._expected & 1 << board.wrong_servo >> 1:
            return self._wrong_setting(board)
        if hot := self._expected & hot_servos(dict(enumerate(board.temperature))):
            return self._joints.hot(hot)
        if far := self._expected & board.servo_far:
            return self._joints.about(far, Code.SERVO_FAR)
        if limp := self._expected & board.servo_checked & ~board.servo_torque:
            return self._joints.about(limp, Code.SERVO_LIMP)
        return None

    def last_trip(self, board: Telemetry) -> str:
        """Return the reason of the last trip, with the affected servos."""
        if not board.trip:
            return "none"
        text = _trip_text(board.trip)
        stuck = _stuck(board)
        if not stuck:
            return text
        return sentence(
            self._joints.about(stuck, Code.GIMBALS_STUCK, because(Code.TEXT, text=text))
        )

    def _wrong_setting(self, board: Telemetry) -> Reason:
        servo = board.wrong_servo - 1
        named, model = self._joints.named(1 << servo), board.servo_model[servo]
        return wrong_setting(named, model, board.wrong_register, board.wrong_value)


def past_trips(history: TripHistory, start: int) -> dict[str, str]:
    """Return the last trips as texts by number; 1 is the latest.

    `start` is the count of power-ups of the board.
    """
    columns = (history.past_trip, history.past_start, history.past_uptime_s, history.past_lowest)
    found: dict[str, str] = {}
    for number, (trip, at, uptime_s, lowest) in enumerate(zip(*columns, strict=True), 1):
        if trip:
            ago = (start - at) % 256
            found[str(number)] = (
                f"{_trip_text(trip)}; {uptime_s} s after a start, "
                f"{f'power-up {ago} before this one' if ago else 'in this power-up'}"
                + (f"; battery down to {lowest / 10.0:.1f} V" if lowest else "")
            )
    return found


def _trip_text(trip: int) -> str:
    word = trip_word(trip)
    return WORDS[Type.TRIP].get(word, word)


def _stuck(board: Telemetry) -> int:
    """Mask of the servos that do not follow."""
    return board.servo_stuck if board.trip == Trip.FOLLOWING else 0


def _obstacle(refusal: Refusal) -> Reason:
    return because(Code.ARMING_OBSTACLE, what=obstacle_word(refusal))
