"""Numbers of the controller board that have a meaning: modes, trips, refusals of arming."""

from __future__ import annotations

from enum import IntEnum, IntFlag


class BoardMode(IntEnum):
    """Who has the joints."""

    DISARMED = 0
    """Nobody: zero throttle, gimbals to neutral."""
    ARMED = 1
    """The PC: throttles and goals of the command block are put out."""
    RC = 2
    """The radio control: the command block is ignored, and arming refused."""


class Trip(IntEnum):
    """Why the board last disarmed itself; stays until it is armed again."""

    NONE = 0
    HEARTBEAT = 1
    """The heartbeat did not change for `heartbeat_timeout_ms` while armed."""
    KILL = 2
    """The kill switch of the radio control."""
    RC_LOST = 3
    """The radio control was there, and its pulses ceased."""
    RC_TOOK_OVER = 4
    """The radio control was switched to manual while the PC had the robot."""
    SERVO = 5
    """A servo of `servos_expected` no longer answers, or reports a hardware error."""
    WATCHDOG = 6
    """The firmware hung, and its watchdog reset it."""


class Refusal(IntEnum):
    """Why arming was last refused; 0 once it succeeds."""

    NONE = 0
    ESC_HOLD = 1
    """Zero throttle has not been put out for `esc_hold_ms` yet."""
    THROTTLE = 2
    """A throttle of the command block is not zero throttle."""
    GOAL = 3
    """A goal of the command block is not 0."""
    SERVO = 4
    """A servo of `servos_expected` does not answer, or reports a hardware error."""
    NOT_NEUTRAL = 5
    """A gimbal is measured more than `neutral_band` from neutral."""
    KILL = 6
    """The kill switch is on, or the radio control was there and is lost."""
    RC = 7
    """The radio control has the robot."""
    SETUP = 8
    """No set-up was ever written: where neutral is, is not known."""


class ResetCause(IntFlag):
    """Why the board started: the bits of MCUSR."""

    POWER_ON = 1
    EXTERNAL = 2
    BROWN_OUT = 4
    WATCHDOG = 8


class RcChannel(IntEnum):
    """Which entry of `rc` is what; a switch is on the side of its pulse, seen from `SWITCH_US`."""

    FORWARD = 0
    LEFT = 1
    TURN = 2
    SPEED = 3
    KILL = 4
    """Shorter kills: a receiver that loses its transmitter is set to do that."""
    MANUAL = 5
    """Longer gives the robot to the radio control."""


SWITCH_US = 1500
