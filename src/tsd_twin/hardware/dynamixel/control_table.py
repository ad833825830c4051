"""Control table of the controller board, the single source for the C header, structs and docs.

`python -m tsd_twin.hardware.dynamixel` generates these files. This module also defines the codes
for modes, trips and refusals.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Literal

TABLE_VERSION = 5
FW_VERSION = 5
MODEL = 2014
"""Model number in ping responses; the year of the thesis."""
BOARD_ID = 200
"""Same id as TurtleBot3's board, outside the usual range of servos."""
SERVOS = 6
ESCS = 3
RC_CHANNELS = 6
RECEIVER_CHANNELS = 16
"""Number of SBUS channels."""
STICKS = 4
"""The first four channels: forward, left, turn, speed."""
SERVO_HOT_C = 75
"""A servo at this temperature stops the robot, before it switches itself off at 80."""
RC_US = (800, 2200)
"""Shortest and longest valid receiver pulse."""
ZERO_THROTTLE = 2000
"""Half microseconds, for speed controllers with a pulse range of 1000 to 2000 us."""
FULL_THROTTLE = 4000

Type = Literal["u8", "u16", "u32", "i16"]
Access = Literal["r", "w", "setup"]
"""Read only; writable at any time; writable while disarmed, else error 7."""
SIZES: dict[Type, int] = {"u8": 1, "u16": 2, "u32": 4, "i16": 2}


@dataclass(frozen=True, slots=True)
class Item:
    """Table entry: a number, or an array of `count` numbers."""

    name: str
    type: Type
    doc: str
    default: int = 0
    """Value after a reset."""
    limits: tuple[int, int] | None = None
    """Smallest and largest writable value; others are error 4, and the whole write is rejected."""
    unit: str = ""
    count: int = 1
    rise: int = 0
    """Increment of the default from one array element to the next."""

    @property
    def size(self) -> int:
        """Size in bytes."""
        return SIZES[self.type] * self.count


@dataclass(frozen=True, slots=True)
class Block:
    """Adjacent items that are read or written together."""

    name: str
    access: Access
    doc: str
    items: tuple[Item, ...]

    @property
    def size(self) -> int:
        """Size in bytes."""
        return sum(item.size for item in self.items)


IDENTITY = Block(
    "identity",
    "r",
    "Identity of the board and fixed parameters.",
    (
        Item("model", "u16", "Model number of the board.", MODEL),
        Item("fw", "u8", "Firmware version, also in ping responses.", FW_VERSION),
        Item("table_version", "u8", "Version of this table.", TABLE_VERSION),
        Item("id", "u8", "Dynamixel id.", BOARD_ID),
        Item("host_baud", "u32", "Baud rate of the line to the PC.", 1_000_000, unit="Bd"),
        Item("servo_baud", "u32", "Baud rate of the servo bus.", 1_000_000, unit="Bd"),
        Item("heartbeat_timeout_ms", "u16", "Trip timeout without a heartbeat.", 500, unit="ms"),
        Item("watchdog_ms", "u16", "Watchdog timeout that resets a hung firmware.", 250, unit="ms"),
        Item(
            "esc_hold_ms",
            "u16",
            "Required duration of zero throttle before arming.",
            2000,
            unit="ms",
        ),
        Item("neutral_band", "u16", "Tolerance of the neutral position.", 11, unit="step"),
        Item(
            "servo_hot_c",
            "u8",
            "Servo temperature that prevents arming and trips.",
            SERVO_HOT_C,
            unit="deg C",
        ),
    ),
)

SETUP = Block(
    "setup",
    "setup",
    "Robot parameters in EEPROM. Written as a whole, at least 2 s after the last throttle.",
    (
        Item(
            "servo_id",
            "u8",
            "Unique servo ids: alpha and beta of module 1, then 2, then 3.",
            1,
            (1, 252),
            count=SERVOS,
            rise=1,
        ),
        Item("neutral", "u16", "Servo position at neutral.", 2048, (0, 4095), "step", SERVOS),
        Item("reverse", "u8", "Bit i: servo i turns in the opposite direction.", 0, (0, 63)),
        Item("goal_limit", "u16", "Goals are clamped to ± this value.", 341, (0, 1023), "step"),
        Item(
            "servos_expected",
            "u8",
            "Bit i: servo i must respond to arm and stay armed; 0 if the board drives no servos.",
            63,
            (0, 63),
        ),
        Item("battery_arm_mv", "u16", "Minimum battery voltage for arming.", 0, (0, 65535), "mV"),
        Item(
            "battery_stop_mv",
            "u16",
            "Trips if the battery is below this voltage for 1 s.",
            0,
            (0, 65535),
            "mV",
        ),
        Item(
            "bandgap_mv",
            "u16",
            "Bandgap voltage of the chip, the reference for its supply voltage.",
            1100,
            (1000, 1200),
            "mV",
        ),
        Item(
            "receiver_expected",
            "u8",
            "1: arming and staying armed requires a receiver, even if none was seen since "
            "power-on.",
            0,
            (0, 1),
        ),
        Item(
            "stick_low",
            "u16",
            "Pulses at the low ends of forward, left, turn, speed.",
            1100,
            RC_US,
            "us",
            STICKS,
        ),
        Item("stick_centre", "u16", "Pulses at rest; unused for speed.", 1500, RC_US, "us", STICKS),
        Item("stick_high", "u16", "Pulses at the high ends.", 1900, RC_US, "us", STICKS),
        Item("stick_dead", "u8", "Dead band at the centre and at both ends.", 20, (0, 100), "us"),
        Item("receiver_kind", "u8", "Signal type of the receiver: `ReceiverKind`.", 0, (0, 1)),
        Item(
            "receiver_map",
            "u32",
            "Channels of forward, left, turn, speed, kill, manual: 4 bits each, lowest first.",
            0x543210,
            (0, 0xFFFFFF),
        ),
        Item(
            "pulse_low",
            "u16",
            "Pulse at zero throttle per speed controller; writable only while they have no power.",
            ZERO_THROTTLE,
            (ZERO_THROTTLE, 2400),
            "0.5 us",
            ESCS,
        ),
        Item("pulse_high", "u16", "Pulse at full throttle.", 4000, (3000, 4400), "0.5 us", ESCS),
        Item(
            "throttle_limit",
            "u16",
            "Maximum throttle from any source.",
            FULL_THROTTLE,
            (ZERO_THROTTLE, FULL_THROTTLE),
            "",
            ESCS,
        ),
        Item(
            "throttle_rise",
            "u16",
            "Maximum throttle increase per 10 ms; decreases are immediate.",
            FULL_THROTTLE - ZERO_THROTTLE,
            (1, FULL_THROTTLE - ZERO_THROTTLE),
        ),
    ),
)

COMMAND = Block(
    "command",
    "w",
    "Joint commands: one WRITE of the whole block per cycle; a partial one is error 5.",
    (
        Item(
            "heartbeat",
            "u16",
            "Heartbeat counter; must change to arm. While armed, an older counter is error 7.",
            0,
            (0, 65535),
        ),
        Item(
            "arm",
            "u8",
            "Changing 0 to 1 arms unless refused; 0 disarms. After a trip, 0 must be written "
            "first; repeating 1 never re-arms. 2 is STOP, also for the radio control: no source "
            "gets control until a 0 is written in this session.",
            0,
            (0, 2),
        ),
        Item("torque", "u8", "0 switches servo torque off; only while disarmed.", 1, (0, 1)),
        Item(
            "throttle",
            "u16",
            "Throttle per speed controller, from `pulse_low` at 2000 to `pulse_high` at 4000; "
            "applied while armed.",
            ZERO_THROTTLE,
            (ZERO_THROTTLE, FULL_THROTTLE),
            "",
            ESCS,
        ),
        Item(
            "goal",
            "i16",
            "Gimbal goals from neutral: alpha and beta of module 1, then 2, then 3; used if armed.",
            0,
            (-1023, 1023),
            "step",
            SERVOS,
        ),
        Item(
            "session",
            "u16",
            "Must equal `nonce`; else the block can only disarm or stop, and `arm` 1 is error 7.",
            0,
            (0, 65535),
            count=2,
        ),
    ),
)

TELEMETRY = Block(
    "telemetry",
    "r",
    "Measurements and states: one READ per cycle.",
    (
        Item("millis", "u32", "Time since the reset.", unit="ms"),
        Item("mode", "u8", "Source of the joint commands: `BoardMode`."),
        Item("trip", "u8", "Reason of the last trip, until the board is armed: `Trip`."),
        Item("refusal", "u8", "Reason of the last refusal to arm: `Refusal`."),
        Item("reset_cause", "u8", "Reason of the last reset: `ResetCause`."),
        Item("beat", "u16", "Echo of the last written heartbeat."),
        Item(
            "nonce",
            "u16",
            "Session number; changes at each start, each disarming, and each 1 in `arm` that "
            "does not arm.",
            count=2,
        ),
        Item("setup_known", "u8", "1: a setup was ever written."),
        Item("drive_on", "u8", "1: the speed controllers have power, behind the contactor."),
        Item(
            "esc_ready",
            "u8",
            "1: zero throttle was output for `esc_hold_ms` since the speed controllers got power "
            "and since the last disarming.",
        ),
        Item("servo_found", "u8", "Bit i: servo i responded to a ping."),
        Item("servo_alive", "u8", "Bit i: servo i responded within the last 50 ms."),
        Item("servo_protocol", "u8", "Bit i: servo i uses Protocol 2.0, else 1.0."),
        Item("servo_fault", "u8", "Bit i: servo i reports a hardware error."),
        Item("servo_torque", "u8", "Bit i: servo i reported torque on within the last 150 ms."),
        Item("servo_checked", "u8", "Bit i: the settings of servo i have the required values."),
        Item(
            "wrong_servo",
            "u8",
            "Number (from 1) of a servo with a wrong setting, see the next two items; else 0.",
        ),
        Item(
            "wrong_register", "u8", "Address of the setting in the servo's table; 0: model number."
        ),
        Item("wrong_value", "u32", "Value of the setting."),
        Item("throttle_out", "u16", "Current throttle output.", ZERO_THROTTLE, None, "", ESCS),
        Item("position", "i16", "Gimbal positions from neutral.", 0, None, "step", SERVOS),
        Item("velocity", "i16", "Gimbal velocities.", 0, None, "step/s", SERVOS),
        Item("current", "i16", "Servo currents.", 0, None, "mA", SERVOS),
        Item("voltage", "u8", "Servo voltages.", 0, None, "0.1 V", SERVOS),
        Item("temperature", "u8", "Servo temperatures.", 0, None, "deg C", SERVOS),
        Item(
            "rc",
            "u16",
            "Receiver pulses: forward, left, turn, speed, kill, manual; 0 if missing.",
            0,
            None,
            "us",
            RC_CHANNELS,
        ),
        Item("battery_mv", "u16", "Battery voltage.", unit="mV"),
        Item("drive_mv", "u16", "Speed-controller voltage, behind the contactor.", unit="mV"),
        Item(
            "supply_mv", "u16", "Board supply voltage, the reference for the other two.", unit="mV"
        ),
        Item("crc_errors", "u16", "Packets from the PC with a wrong CRC."),
        Item("rx_errors", "u16", "Lost bytes and abandoned incomplete packets from the PC."),
        Item("servo_errors", "u16", "Missing or invalid servo responses."),
        Item("overruns", "u16", "Cycles longer than 10 ms."),
        Item("trips", "u16", "Number of trips since power-on."),
        Item("resets", "u16", "Number of resets since power-on."),
        Item("stop_proven", "u8", "1: the stop circuit has been open since power-on."),
        Item(
            "servo_far",
            "u8",
            "Bit i: servo i has not been within 100 steps of `neutral` since power-on or a "
            "change of `neutral`, so it gets no torque.",
        ),
        Item("servo_stuck", "u8", "Bit i: servo i did not follow its goal at the last trip."),
        Item("servo_model", "u16", "Servo model numbers; 0 if not read.", count=SERVOS),
        Item(
            "servo_missed",
            "u8",
            "Missing or invalid responses per servo; wraps from 255 to 0.",
            count=SERVOS,
        ),
    ),
)

RADIO = Block(
    "radio",
    "r",
    "All receiver channels of both types, for setting up the receiver.",
    (
        Item(
            "channel",
            "u16",
            "SBUS channels, then the pulses of the wires; 0 if missing.",
            0,
            None,
            "us",
            RECEIVER_CHANNELS + RC_CHANNELS,
        ),
    ),
)

BLOCKS = (IDENTITY, SETUP, COMMAND, TELEMETRY, RADIO)


def addresses() -> dict[str, int]:
    """Return the address of each item and each block."""
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
    """No source: zero throttle, gimbals move to neutral."""
    ARMED = 1
    """The PC: throttles and goals of the command block are applied."""
    RC = 2
    """The radio control: the command block is ignored, and arming is refused."""


class Trip(IntEnum):
    """Reason why the board last disarmed itself; kept until it is armed again."""

    NONE = 0
    HEARTBEAT = 1
    """The heartbeat did not change for `heartbeat_timeout_ms` while armed."""
    KILL = 2
    """The kill switch of the radio control is on."""
    RC_LOST = 3
    """The pulses of the radio control ceased."""
    RC_TOOK_OVER = 4
    """The radio control was switched to manual while the PC was in control."""
    SERVO = 5
    """A servo in `servos_expected` stopped responding or reports a hardware error."""
    WATCHDOG = 6
    """The firmware hung and was reset by its watchdog."""
    DRIVE = 7
    """The speed controllers lost power because the stop circuit opened."""
    BATTERY = 8
    """The battery was below `battery_stop_mv` for 1 s."""
    TORQUE = 9
    """A servo in `servos_expected` lost torque: switched off, or the servo restarted."""
    FOLLOWING = 10
    """A servo in `servos_expected` does not follow its goal."""
    HOT = 12
    """A servo in `servos_expected` reached `servo_hot_c`."""
    LINE = 13
    """Servos missed responses or torque checks, and in the same 50 ms bytes from the PC were lost
    or corrupt: the line kept the board too busy.
    """
    STOPPED = 14
    """The PC wrote 2 to `arm`: STOP."""


class Refusal(IntEnum):
    """Reason why arming was last refused; 0 once it succeeds."""

    NONE = 0
    ESC_HOLD = 1
    """Zero throttle has not been output for `esc_hold_ms` since the speed controllers got power and
    since the last disarming.
    """
    THROTTLE = 2
    """A throttle in the command block is not zero."""
    GOAL = 3
    """A goal in the command block is not 0."""
    SERVO = 4
    """A servo in `servos_expected` does not respond or reports a hardware error."""
    NOT_NEUTRAL = 5
    """A measured gimbal position is more than `neutral_band` from neutral."""
    KILL = 6
    """The kill switch is on."""
    RC = 7
    """The radio control is in control of the robot."""
    SETUP = 8
    """No setup was ever written, so the neutral positions are unknown."""
    DRIVE = 9
    """The speed controllers have no power because the stop circuit is open."""
    BATTERY = 10
    """The battery is below `battery_arm_mv`."""
    RECEIVER = 11
    """A channel has no pulses, although a receiver is expected or was seen."""
    SETTING = 12
    """A setting of a servo in `servos_expected` is wrong or unread."""
    TORQUE = 13
    """A servo in `servos_expected` has no torque."""
    STOP_NOT_PROVEN = 14
    """The stop circuit has not been open since power-on, so its function is unproven."""
    RC_WITHOUT_SERVOS = 15
    """Radio control requires all six servos at the board: `servos_expected` must be 63."""
    NEUTRAL = 17
    """A servo in `servos_expected` is far from its `neutral` and gets no torque."""
    HOT = 18
    """A servo in `servos_expected` reached `servo_hot_c`."""
    STOPPED = 19
    """STOP (2 in `arm`) is not released."""


class ResetCause(IntFlag):
    """Reason why the board started: the bits of MCUSR."""

    POWER_ON = 1
    EXTERNAL = 2
    BROWN_OUT = 4
    WATCHDOG = 8


class ReceiverKind(IntEnum):
    """Signal type of the radio receiver."""

    PULSES = 0
    """One wire per channel (six)."""
    SBUS = 1
    """One wire with frames of 16 channels."""


class RcChannel(IntEnum):
    """Entries of `rc`; the pulse of a switch is compared with `SWITCH_US`."""

    FORWARD = 0
    LEFT = 1
    TURN = 2
    SPEED = 3
    KILL = 4
    """Shorter pulses kill; the receiver's fail-safe must be set to this."""
    MANUAL = 5
    """Longer pulses give control to the radio."""


SWITCH_US = 1500
