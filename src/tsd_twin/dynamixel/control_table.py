"""Control table of the controller board: the single definition that C header, structs and docs are
generated from.

`python -m tsd_twin.dynamixel` writes what is generated. Codes of modes, trips and refusals are here
as well, and the base class of the generated blocks.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Literal

TABLE_VERSION = 5
FW_VERSION = 5
MODEL = 2014
"""What a ping answers; the year of the thesis."""
BOARD_ID = 200
"""The id of TurtleBot3's board as well, out of the way of servos."""
SERVOS = 6
ESCS = 3
RC_CHANNELS = 6
RECEIVER_CHANNELS = 16
"""Of a receiver with SBUS."""
STICKS = 4
"""The first four channels: forward, left, turn, speed."""
SERVO_HOT_C = 75
"""A servo this hot stops the robot, before it switches itself off at 80."""
RC_US = (800, 2200)
"""Pulses of a receiver, at the least and at the most."""
ZERO_THROTTLE = 2000
"""In half microseconds, for a speed controller whose pulses end at 1000 and 2000 us."""
FULL_THROTTLE = 4000

Type = Literal["u8", "u16", "u32", "i16"]
Access = Literal["r", "w", "setup"]
"""Read only; written at any time; written while disarmed only, else error 7."""
SIZES: dict[Type, int] = {"u8": 1, "u16": 2, "u32": 4, "i16": 2}


@dataclass(frozen=True, slots=True)
class Item:
    """One entry: a number, or an array of `count` of them."""

    name: str
    type: Type
    doc: str
    default: int = 0
    """Value after a reset."""
    limits: tuple[int, int] | None = None
    """Smallest and largest that can be written; another is error 4, and nothing of it is taken."""
    unit: str = ""
    count: int = 1
    rise: int = 0
    """What the default of each further entry of an array is above that of the one before."""

    @property
    def size(self) -> int:
        """Bytes."""
        return SIZES[self.type] * self.count


@dataclass(frozen=True, slots=True)
class Block:
    """Neighbours that are read or written together."""

    name: str
    access: Access
    doc: str
    items: tuple[Item, ...]

    @property
    def size(self) -> int:
        """Bytes."""
        return sum(item.size for item in self.items)


IDENTITY = Block(
    "identity",
    "r",
    "Identity of the board, and fixed parameters.",
    (
        Item("model", "u16", "Kind of board.", MODEL),
        Item("fw", "u8", "Version of the firmware, as a ping answers it.", FW_VERSION),
        Item("table_version", "u8", "Version of this table.", TABLE_VERSION),
        Item("id", "u8", "Id on the wire.", BOARD_ID),
        Item("host_baud", "u32", "Rate of the line to the PC.", 1_000_000, unit="Bd"),
        Item("servo_baud", "u32", "Rate of the servo bus.", 1_000_000, unit="Bd"),
        Item("heartbeat_timeout_ms", "u16", "Trips after this without a beat.", 500, unit="ms"),
        Item("watchdog_ms", "u16", "A hung firmware is reset after this.", 250, unit="ms"),
        Item("esc_hold_ms", "u16", "Zero throttle before arming.", 2000, unit="ms"),
        Item("neutral_band", "u16", "Neutral is within this.", 11, unit="step"),
        Item(
            "servo_hot_c",
            "u8",
            "A servo this hot does not arm, and trips.",
            SERVO_HOT_C,
            unit="deg C",
        ),
    ),
)

SETUP = Block(
    "setup",
    "setup",
    "Parameters of the robot; kept without power. Written as a whole, 2 s after a throttle.",
    (
        Item(
            "servo_id",
            "u8",
            "Id of each servo, all different: alpha and beta of module 1, then 2, then 3.",
            1,
            (1, 252),
            count=SERVOS,
            rise=1,
        ),
        Item("neutral", "u16", "Servo position of neutral.", 2048, (0, 4095), "step", SERVOS),
        Item("reverse", "u8", "Bit i: servo i turns the other way.", 0, (0, 63)),
        Item("goal_limit", "u16", "Goals are held within ± this.", 341, (0, 1023), "step"),
        Item(
            "servos_expected",
            "u8",
            "Bit i: servo i must answer to arm and to stay armed; 0 when others drive the servos.",
            63,
            (0, 63),
        ),
        Item("battery_arm_mv", "u16", "No arming below this.", 0, (0, 65535), "mV"),
        Item("battery_stop_mv", "u16", "Trips below this for 1 s.", 0, (0, 65535), "mV"),
        Item(
            "bandgap_mv",
            "u16",
            "Of the chip's bandgap, which its supply is measured against.",
            1100,
            (1000, 1200),
            "mV",
        ),
        Item(
            "receiver_expected",
            "u8",
            "1: a receiver must be there to arm and stay armed, though none was seen since power "
            "came.",
            0,
            (0, 1),
        ),
        Item(
            "stick_low",
            "u16",
            "Pulse at the low end of forward, left, turn, speed.",
            1100,
            RC_US,
            "us",
            STICKS,
        ),
        Item("stick_centre", "u16", "At rest; of the speed unused.", 1500, RC_US, "us", STICKS),
        Item("stick_high", "u16", "At the high end.", 1900, RC_US, "us", STICKS),
        Item("stick_dead", "u8", "Dead band at the centre, and at both ends.", 20, (0, 100), "us"),
        Item("receiver_kind", "u8", "What the receiver sends: `ReceiverKind`.", 0, (0, 1)),
        Item(
            "receiver_map",
            "u32",
            "Channel of forward, left, turn, speed, kill, manual: 4 bits each, from the lowest.",
            0x543210,
            (0, 0xFFFFFF),
        ),
        Item(
            "pulse_low",
            "u16",
            "Pulse of zero throttle of each speed controller; another only without power at them.",
            ZERO_THROTTLE,
            (ZERO_THROTTLE, 2400),
            "0.5 us",
            ESCS,
        ),
        Item("pulse_high", "u16", "Of full throttle.", 4000, (3000, 4400), "0.5 us", ESCS),
        Item(
            "throttle_limit",
            "u16",
            "No throttle exceeds this, whatever the source.",
            FULL_THROTTLE,
            (ZERO_THROTTLE, FULL_THROTTLE),
            "",
            ESCS,
        ),
        Item(
            "throttle_rise",
            "u16",
            "Most by which a throttle rises in 10 ms; it falls at once.",
            FULL_THROTTLE - ZERO_THROTTLE,
            (1, FULL_THROTTLE - ZERO_THROTTLE),
        ),
    ),
)

COMMAND = Block(
    "command",
    "w",
    "Joint commands: one WRITE of the whole block in each cycle; a partial one is error 5.",
    (
        Item(
            "heartbeat",
            "u16",
            "A change is a beat; arming needs one. While armed, a block that is behind is error 7.",
            0,
            (0, 65535),
        ),
        Item(
            "arm",
            "u8",
            "Going from 0 to 1 arms, unless there is a reason to refuse; 0 disarms. After a trip "
            "it has to be written 0 first: 1 again and again never arms again. 2 is STOP, for the "
            "radio control too: until a 0 of this session no source gets the robot.",
            0,
            (0, 2),
        ),
        Item("torque", "u8", "0 switches servo torque off, while disarmed only.", 1, (0, 1)),
        Item(
            "throttle",
            "u16",
            "Of each speed controller, from `pulse_low` at 2000 to `pulse_high` at 4000; put out "
            "while armed.",
            ZERO_THROTTLE,
            (ZERO_THROTTLE, FULL_THROTTLE),
            "",
            ESCS,
        ),
        Item(
            "goal",
            "i16",
            "Gimbals from neutral: alpha and beta of module 1, then 2, then 3; obeyed while armed.",
            0,
            (-1023, 1023),
            "step",
            SERVOS,
        ),
        Item(
            "session",
            "u16",
            "As `nonce`, or the block only disarms or stops: with `arm` 1 it is error 7.",
            0,
            (0, 65535),
            count=2,
        ),
    ),
)

TELEMETRY = Block(
    "telemetry",
    "r",
    "Measurements and states: one READ in each cycle.",
    (
        Item("millis", "u32", "Since the reset.", unit="ms"),
        Item("mode", "u8", "Source of the joint commands: `BoardMode`."),
        Item("trip", "u8", "Why the board last disarmed itself, until it arms: `Trip`."),
        Item("refusal", "u8", "Why arming was last refused: `Refusal`."),
        Item("reset_cause", "u8", "Why the board started: `ResetCause`."),
        Item("beat", "u16", "Echo of the heartbeat that was written last."),
        Item(
            "nonce",
            "u16",
            "Number of this session; another after each start, each disarming, and each 1 in `arm` "
            "that does not arm.",
            count=2,
        ),
        Item("setup_known", "u8", "1: the setup was written, now or before."),
        Item("drive_on", "u8", "1: the speed controllers have power, behind the contactor."),
        Item(
            "esc_ready",
            "u8",
            "1: zero throttle was put out for `esc_hold_ms`, since the speed controllers got power "
            "and since the last disarming.",
        ),
        Item("servo_found", "u8", "Bit i: servo i answered a ping."),
        Item("servo_alive", "u8", "Bit i: servo i answered within the last 50 ms."),
        Item("servo_protocol", "u8", "Bit i: servo i speaks Protocol 2.0, else 1.0."),
        Item("servo_fault", "u8", "Bit i: servo i reports a hardware error."),
        Item("servo_torque", "u8", "Bit i: servo i said within the last 150 ms that it holds."),
        Item("servo_checked", "u8", "Bit i: the settings of servo i have the required values."),
        Item(
            "wrong_servo",
            "u8",
            "Number, from 1, of a servo with a wrong setting, which the next two name; 0: none.",
        ),
        Item("wrong_register", "u8", "Its address in the table of the servo; 0: its model."),
        Item("wrong_value", "u32", "What it is there."),
        Item("throttle_out", "u16", "Throttle that is put out.", ZERO_THROTTLE, None, "", ESCS),
        Item("position", "i16", "Gimbals from neutral.", 0, None, "step", SERVOS),
        Item("velocity", "i16", "Gimbals.", 0, None, "step/s", SERVOS),
        Item("current", "i16", "Of the servos.", 0, None, "mA", SERVOS),
        Item("voltage", "u8", "At the servos.", 0, None, "0.1 V", SERVOS),
        Item("temperature", "u8", "Of the servos.", 0, None, "deg C", SERVOS),
        Item(
            "rc",
            "u16",
            "Pulses of the receiver: forward, left, turn, speed, kill, manual; 0: no pulses.",
            0,
            None,
            "us",
            RC_CHANNELS,
        ),
        Item("battery_mv", "u16", "Of the battery.", unit="mV"),
        Item("drive_mv", "u16", "Of the speed controllers, behind the contactor.", unit="mV"),
        Item("supply_mv", "u16", "Of the board; the reference of the other two.", unit="mV"),
        Item("crc_errors", "u16", "Packets from the PC with a wrong sum."),
        Item("rx_errors", "u16", "Bytes from the PC lost, or cut packets given up."),
        Item("servo_errors", "u16", "Answers of servos that were missing or wrong."),
        Item("overruns", "u16", "Cycles that took longer than 10 ms."),
        Item("trips", "u16", "Times that the board disarmed itself since power came."),
        Item("resets", "u16", "Resets since power came."),
        Item("stop_proven", "u8", "1: the stop circuit was seen open since power came."),
        Item(
            "servo_far",
            "u8",
            "Bit i: servo i was not within 100 steps of its `neutral` yet, since power came or "
            "`neutral` changed: it gets no torque.",
        ),
        Item("servo_stuck", "u8", "Bit i: servo i did not follow its goal, at the last trip."),
        Item("servo_model", "u16", "Model numbers of the servos; 0: not read.", count=SERVOS),
        Item(
            "servo_missed",
            "u8",
            "Missing or wrong answers of each servo; from 255 on to 0.",
            count=SERVOS,
        ),
    ),
)

RADIO = Block(
    "radio",
    "r",
    "All that receivers of either kind send: for their set-up.",
    (
        Item(
            "channel",
            "u16",
            "The channels of a frame, then the pulses of the wires; 0: none.",
            0,
            None,
            "us",
            RECEIVER_CHANNELS + RC_CHANNELS,
        ),
    ),
)

BLOCKS = (IDENTITY, SETUP, COMMAND, TELEMETRY, RADIO)


def addresses() -> dict[str, int]:
    """Return where each item and each block begins."""
    found: dict[str, int] = {}
    at = 0
    for block in BLOCKS:
        found[block.name] = at
        for item in block.items:
            found[item.name] = at
            at += item.size
    return found


ADDRESS = addresses()
TABLE_SIZE = sum(block.size for block in BLOCKS)


class BoardMode(IntEnum):
    """Source of the joint commands."""

    DISARMED = 0
    """No source: zero throttle, gimbals to neutral."""
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
    DRIVE = 7
    """The speed controllers lost their power: the stop circuit opened."""
    BATTERY = 8
    """The battery was below `battery_stop_mv` for 1 s."""
    TORQUE = 9
    """A servo of `servos_expected` does not hold: its torque was switched off, or it restarted."""
    FOLLOWING = 10
    """A servo of `servos_expected` does not follow its goal."""
    HOT = 12
    """A servo of `servos_expected` has `servo_hot_c`."""
    LINE = 13
    """Servos were not heard or did not say that they hold, and in the same 50 ms bytes from the PC
    were lost or wrong: its line kept the board too busy."""
    STOPPED = 14
    """The PC wrote 2 to `arm`: STOP."""


class Refusal(IntEnum):
    """Why arming was last refused; 0 once it succeeds."""

    NONE = 0
    ESC_HOLD = 1
    """Zero throttle has not been put out for `esc_hold_ms` yet, at speed controllers with power,
    since the last disarming."""
    THROTTLE = 2
    """A throttle of the command block is not zero throttle."""
    GOAL = 3
    """A goal of the command block is not 0."""
    SERVO = 4
    """A servo of `servos_expected` does not answer, or reports a hardware error."""
    NOT_NEUTRAL = 5
    """A gimbal is measured more than `neutral_band` from neutral."""
    KILL = 6
    """The kill switch is on."""
    RC = 7
    """The radio control has the robot."""
    SETUP = 8
    """No set-up was ever written: where neutral is, is not known."""
    DRIVE = 9
    """The speed controllers have no power: the stop circuit is open."""
    BATTERY = 10
    """The battery is below `battery_arm_mv`."""
    RECEIVER = 11
    """A receiver is expected, or was there, and a channel has no pulses."""
    SETTING = 12
    """A setting of a servo of `servos_expected` differs from the required value, or is unread."""
    TORQUE = 13
    """A servo of `servos_expected` does not hold."""
    STOP_NOT_PROVEN = 14
    """The stop circuit was not seen open since power came: whether it can stop is not known."""
    RC_WITHOUT_SERVOS = 15
    """The radio control drives with all six servos at the board: `servos_expected` must be 63."""
    NEUTRAL = 17
    """A servo of `servos_expected` is far from its `neutral`, and gets no torque."""
    HOT = 18
    """A servo of `servos_expected` has `servo_hot_c`."""
    STOPPED = 19
    """STOP, as of 2 in `arm`, is not released."""


class ResetCause(IntFlag):
    """Why the board started: the bits of MCUSR."""

    POWER_ON = 1
    EXTERNAL = 2
    BROWN_OUT = 4
    WATCHDOG = 8


class ReceiverKind(IntEnum):
    """What the receiver of the radio control sends."""

    PULSES = 0
    """A wire for each of six channels."""
    SBUS = 1
    """One wire, with frames of 16 channels."""


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
