"""Control table of the controller board, the single source for the C header and the docs page.

`python -m tsd_twin.hardware.dynamixel` generates these files. This module also defines the codes
for modes, trips and refusals.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from enum import IntEnum, IntFlag
from functools import cache
from itertools import islice
from struct import Struct, calcsize
from typing import Annotated, ClassVar, Literal, Self, cast, get_type_hints

TABLE_VERSION = 8
FW_VERSION = 8
MODEL = 2014
"""Model number in ping responses; the year of the thesis."""
BOARD_ID = 200
"""Same id as TurtleBot3's board, outside the usual range of servos."""
SERVOS = 6
ESCS = 3
RC_CHANNELS = 6
RECEIVER_CHANNELS = 16
"""Number of SBUS channels."""
PAST_TRIPS = 8
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
Ints = tuple[int, ...]
_LETTERS: dict[Type, str] = {"u8": "B", "u16": "H", "u32": "I", "i16": "h"}


@dataclass(frozen=True, slots=True)
class Item:
    """Table entry, as annotation of a field of a `Block`; `Block.items` adds name and default."""

    type: Type
    limits: tuple[int, int] | None = None
    """Smallest and largest writable value; others are error 4, and the whole write is rejected."""
    unit: str = ""
    name: str = ""
    default: int | Ints = 0
    """Value after a reset; a tuple for an array."""

    @property
    def values(self) -> Ints:
        """Value of each number after a reset."""
        return self.default if isinstance(self.default, tuple) else (self.default,)

    @property
    def layout(self) -> str:
        """`struct` format."""
        return f"{len(self.values)}{_LETTERS[self.type]}"


@dataclass(frozen=True, slots=True)
class Block:
    """Adjacent items that are read or written together; array lengths follow from the defaults."""

    NAME: ClassVar[str]
    ACCESS: ClassVar[Access]
    ADDRESS: ClassVar[int]
    LAYOUT: ClassVar[Struct]

    @classmethod
    def items(cls) -> list[Item]:
        """Return the items by address."""
        hints = get_type_hints(cls, include_extras=True)
        return [
            replace(hints[field.name].__metadata__[0], name=field.name, default=field.default)
            for field in fields(cls)
        ]

    def pack(self) -> bytes:
        """Return the bytes of the block."""
        numbers: list[int] = []
        for name, count in _lengths(type(self)):
            value = getattr(self, name)
            if count is None:
                numbers.append(value)
            else:
                numbers += value
        return self.LAYOUT.pack(*numbers)

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """Parse a block."""
        numbers = iter(cls.LAYOUT.unpack(data))
        return cls(
            *(
                next(numbers) if count is None else tuple(islice(numbers, count))
                for _, count in _lengths(cls)
            )
        )


@cache
def _lengths(block: type[Block]) -> list[tuple[str, int | None]]:
    """Return the name of each item, and its length if it is an array."""
    items = [(each.name, cast("int | Ints", each.default)) for each in fields(block)]
    return [(name, len(it) if isinstance(it, tuple) else None) for name, it in items]


@dataclass(frozen=True, slots=True)
class BoardIdentity(Block):
    """Identity of the board and fixed parameters."""

    NAME: ClassVar[str] = "identity"
    ACCESS: ClassVar[Access] = "r"

    model: Annotated[int, Item("u16")] = MODEL
    """Model number of the board."""
    fw: Annotated[int, Item("u8")] = FW_VERSION
    """Firmware version, also in ping responses."""
    table_version: Annotated[int, Item("u8")] = TABLE_VERSION
    """Version of this table."""
    id: Annotated[int, Item("u8")] = BOARD_ID
    """Dynamixel id."""
    host_baud: Annotated[int, Item("u32", unit="Bd")] = 1_000_000
    """Baud rate of the line to the PC."""
    servo_baud: Annotated[int, Item("u32", unit="Bd")] = 1_000_000
    """Baud rate of the servo bus."""
    heartbeat_timeout_ms: Annotated[int, Item("u16", unit="ms")] = 500
    """Trip timeout without a heartbeat."""
    watchdog_ms: Annotated[int, Item("u16", unit="ms")] = 250
    """Watchdog timeout that resets a hung firmware."""
    esc_hold_ms: Annotated[int, Item("u16", unit="ms")] = 2000
    """Required duration of zero throttle before arming."""
    neutral_band: Annotated[int, Item("u16", unit="step")] = 11
    """Tolerance of the neutral position."""
    servo_hot_c: Annotated[int, Item("u8", unit="deg C")] = SERVO_HOT_C
    """Servo temperature that prevents arming and trips."""
    build: Annotated[int, Item("u32")] = 0
    """Hash of the firmware's sources."""


@dataclass(frozen=True, slots=True)
class Setup(Block):
    """Robot parameters in EEPROM. Written as a whole, at least 2 s after the last throttle."""

    NAME: ClassVar[str] = "setup"
    ACCESS: ClassVar[Access] = "setup"

    servo_id: Annotated[Ints, Item("u8", (1, 252))] = tuple(range(1, SERVOS + 1))
    """Unique servo ids: alpha and beta of module 1, then 2, then 3."""
    neutral: Annotated[Ints, Item("u16", (0, 4095), "step")] = (2048,) * SERVOS
    """Servo position at neutral."""
    reverse: Annotated[int, Item("u8", (0, 63))] = 0
    """Bit i: servo i turns in the opposite direction."""
    goal_limit: Annotated[int, Item("u16", (0, 1023), "step")] = 341
    """Goals are clamped to ± this value."""
    servos_expected: Annotated[int, Item("u8", (0, 63))] = 63
    """Bit i: servo i must respond to arm and stay armed; 0 if the board drives no servos."""
    battery_arm_mv: Annotated[int, Item("u16", (0, 65535), "mV")] = 0
    """Minimum battery voltage for arming."""
    battery_stop_mv: Annotated[int, Item("u16", (0, 65535), "mV")] = 0
    """Trips if the battery is below this voltage for 1 s."""
    bandgap_mv: Annotated[int, Item("u16", (1000, 1200), "mV")] = 1100
    """Bandgap voltage of the chip, the reference for its supply voltage."""
    receiver_expected: Annotated[int, Item("u8", (0, 1))] = 0
    """1: arming and staying armed requires a receiver, even if none was seen since power-on."""
    stick_low: Annotated[Ints, Item("u16", RC_US, "us")] = (1100,) * STICKS
    """Pulses at the low ends of forward, left, turn, speed."""
    stick_centre: Annotated[Ints, Item("u16", RC_US, "us")] = (1500,) * STICKS
    """Pulses at rest; unused for speed."""
    stick_high: Annotated[Ints, Item("u16", RC_US, "us")] = (1900,) * STICKS
    """Pulses at the high ends."""
    stick_dead: Annotated[int, Item("u8", (0, 100), "us")] = 20
    """Dead band at the centre and at both ends."""
    receiver_kind: Annotated[int, Item("u8", (0, 1))] = 0
    """Signal type of the receiver: `ReceiverKind`."""
    receiver_map: Annotated[int, Item("u32", (0, 0xFFFFFF))] = 0x543210
    """Channels of forward, left, turn, speed, kill, manual: 4 bits each, lowest first."""
    pulse_low: Annotated[Ints, Item("u16", (ZERO_THROTTLE, 2400), "0.5 us")] = (2000,) * ESCS
    """Pulse at zero throttle per speed controller; writable only while they have no power."""
    pulse_high: Annotated[Ints, Item("u16", (3000, 4400), "0.5 us")] = (4000,) * ESCS
    """Pulse at full throttle."""
    throttle_limit: Annotated[Ints, Item("u16", (ZERO_THROTTLE, FULL_THROTTLE))] = (4000,) * ESCS
    """Maximum throttle from any source."""
    throttle_rise: Annotated[int, Item("u16", (1, FULL_THROTTLE - ZERO_THROTTLE))] = 2000
    """Maximum throttle increase per 10 ms; decreases are immediate."""
    wheel_sensor: Annotated[int, Item("u8", (0, 2))] = 0
    """Source of the wheel speeds: `WheelSensor`. 2 is error 4 on a Mega."""
    wheel_pulses: Annotated[int, Item("u8", (1, 255))] = 1
    """Pulses of a wheel sensor per turn of its wheel; with telemetry, pole pairs of its motor."""


@dataclass(frozen=True, slots=True)
class BoardCommand(Block):
    """Joint commands: one WRITE of the whole block per cycle; a partial one is error 5."""

    NAME: ClassVar[str] = "command"
    ACCESS: ClassVar[Access] = "w"

    heartbeat: Annotated[int, Item("u16", (0, 65535))] = 0
    """Heartbeat counter; must change to arm. While armed, an older counter is error 7."""
    arm: Annotated[int, Item("u8", (0, 2))] = 0
    """Changing 0 to 1 arms unless refused; 0 disarms. After a trip, 0 must be written first;
    repeating 1 never re-arms. 2 is STOP, also for the radio control: no source gets control until
    a 0 is written in this session.
    """
    torque: Annotated[int, Item("u8", (0, 1))] = 1
    """0 switches servo torque off; only while disarmed."""
    throttle: Annotated[Ints, Item("u16", (ZERO_THROTTLE, FULL_THROTTLE))] = (2000,) * ESCS
    """Throttle per speed controller, from `pulse_low` at 2000 to `pulse_high` at 4000; applied
    while armed.
    """
    goal: Annotated[Ints, Item("i16", (-1023, 1023), "step")] = (0,) * SERVOS
    """Gimbal goals from neutral: alpha and beta of module 1, then 2, then 3; used if armed."""
    session: Annotated[Ints, Item("u16", (0, 65535))] = (0,) * 2
    """Must equal `nonce`; else the block can only disarm or stop, and `arm` 1 is error 7."""


@dataclass(frozen=True, slots=True)
class Telemetry(Block):
    """Measurements and states: one READ per cycle."""

    NAME: ClassVar[str] = "telemetry"
    ACCESS: ClassVar[Access] = "r"

    millis: Annotated[int, Item("u32", unit="ms")] = 0
    """Time since the reset."""
    mode: Annotated[int, Item("u8")] = 0
    """Source of the joint commands: `BoardMode`."""
    trip: Annotated[int, Item("u8")] = 0
    """Reason of the last trip, until the board is armed: `Trip`."""
    refusal: Annotated[int, Item("u8")] = 0
    """Reason of the last refusal to arm: `Refusal`."""
    reset_cause: Annotated[int, Item("u8")] = 0
    """Reason of the last reset: `ResetCause`."""
    beat: Annotated[int, Item("u16")] = 0
    """Echo of the last written heartbeat."""
    nonce: Annotated[Ints, Item("u16")] = (0,) * 2
    """Session number; changes at each start, each disarming, and each 1 in `arm` that does not
    arm.
    """
    setup_known: Annotated[int, Item("u8")] = 0
    """1: a setup was ever written."""
    drive_on: Annotated[int, Item("u8")] = 0
    """1: the speed controllers have power, behind the contactor."""
    esc_ready: Annotated[int, Item("u8")] = 0
    """1: zero throttle was output for `esc_hold_ms` since the speed controllers got power and
    since the last disarming.
    """
    servo_found: Annotated[int, Item("u8")] = 0
    """Bit i: servo i responded to a ping."""
    servo_alive: Annotated[int, Item("u8")] = 0
    """Bit i: servo i responded within the last 50 ms."""
    servo_protocol: Annotated[int, Item("u8")] = 0
    """Bit i: servo i uses Protocol 2.0, else 1.0."""
    servo_fault: Annotated[int, Item("u8")] = 0
    """Bit i: servo i reports a hardware error."""
    servo_torque: Annotated[int, Item("u8")] = 0
    """Bit i: servo i reported torque on within the last 150 ms."""
    servo_checked: Annotated[int, Item("u8")] = 0
    """Bit i: the settings of servo i have the required values."""
    wrong_servo: Annotated[int, Item("u8")] = 0
    """Number (from 1) of a servo with a wrong setting, see the next two items; else 0."""
    wrong_register: Annotated[int, Item("u8")] = 0
    """Address of the setting in the servo's table; 0: model number."""
    wrong_value: Annotated[int, Item("u32")] = 0
    """Value of the setting."""
    throttle_out: Annotated[Ints, Item("u16")] = (ZERO_THROTTLE,) * ESCS
    """Current throttle output."""
    position: Annotated[Ints, Item("i16", unit="step")] = (0,) * SERVOS
    """Gimbal positions from neutral."""
    velocity: Annotated[Ints, Item("i16", unit="step/s")] = (0,) * SERVOS
    """Gimbal velocities."""
    current: Annotated[Ints, Item("i16", unit="mA")] = (0,) * SERVOS
    """Servo currents."""
    voltage: Annotated[Ints, Item("u8", unit="0.1 V")] = (0,) * SERVOS
    """Servo voltages."""
    temperature: Annotated[Ints, Item("u8", unit="deg C")] = (0,) * SERVOS
    """Servo temperatures."""
    rc: Annotated[Ints, Item("u16", unit="us")] = (0,) * RC_CHANNELS
    """Receiver pulses: forward, left, turn, speed, kill, manual; 0 if missing."""
    battery_mv: Annotated[int, Item("u16", unit="mV")] = 0
    """Battery voltage."""
    drive_mv: Annotated[int, Item("u16", unit="mV")] = 0
    """Speed-controller voltage, behind the contactor."""
    supply_mv: Annotated[int, Item("u16", unit="mV")] = 0
    """Board supply voltage, the reference for the other two."""
    crc_errors: Annotated[int, Item("u16")] = 0
    """Packets from the PC with a wrong CRC."""
    rx_errors: Annotated[int, Item("u16")] = 0
    """Lost bytes and abandoned incomplete packets from the PC."""
    servo_errors: Annotated[int, Item("u16")] = 0
    """Missing or invalid servo responses."""
    overruns: Annotated[int, Item("u16")] = 0
    """Cycles longer than 10 ms."""
    trips: Annotated[int, Item("u16")] = 0
    """Number of trips since power-on."""
    resets: Annotated[int, Item("u16")] = 0
    """Number of resets since power-on."""
    stop_proven: Annotated[int, Item("u8")] = 0
    """1: the stop circuit has been open since power-on."""
    servo_far: Annotated[int, Item("u8")] = 0
    """Bit i: servo i has not been within 100 steps of `neutral` since power-on or a change of
    `neutral`, so it gets no torque.
    """
    servo_stuck: Annotated[int, Item("u8")] = 0
    """Bit i: servo i did not follow its goal at the last trip."""
    servo_model: Annotated[Ints, Item("u16")] = (0,) * SERVOS
    """Servo model numbers; 0 if not read."""
    servo_missed: Annotated[Ints, Item("u8")] = (0,) * SERVOS
    """Missing or invalid responses per servo; wraps from 255 to 0."""


@dataclass(frozen=True, slots=True)
class Wheels(Block):
    """Wheel speeds: read together with the telemetry, if the robot has wheel sensors."""

    NAME: ClassVar[str] = "wheels"
    ACCESS: ClassVar[Access] = "r"

    wheel_measured: Annotated[int, Item("u8")] = 0
    """Bit i: the sensor of wheel i has sent pulses since the start, so its speed is measured."""
    wheel_rpm: Annotated[Ints, Item("u16", unit="rpm")] = (0,) * ESCS
    """Measured wheel speeds; 0 if not measured."""
    wheel_age: Annotated[Ints, Item("u8", unit="ms")] = (255,) * ESCS
    """Time since the last pulse of each wheel sensor, at most 255."""
    wheel_stuck: Annotated[int, Item("u8")] = 0
    """Number (from 1) of the wheel that did not follow at the last trip, see the next two items;
    else 0.
    """
    stuck_rpm: Annotated[int, Item("u16", unit="rpm")] = 0
    """Measured speed of this wheel."""
    stuck_wanted_rpm: Annotated[int, Item("u16", unit="rpm")] = 0
    """Speed at its throttle."""


@dataclass(frozen=True, slots=True)
class Radio(Block):
    """All receiver channels of both types, for setting up the receiver."""

    NAME: ClassVar[str] = "radio"
    ACCESS: ClassVar[Access] = "r"

    channel: Annotated[Ints, Item("u16", unit="us")] = (0,) * (RECEIVER_CHANNELS + RC_CHANNELS)
    """SBUS channels, then the pulses of the wires; 0 if missing."""


@dataclass(frozen=True, slots=True)
class Geometry(Block):
    """Geometry and limits of the robot that the firmware was built for, used by radio control."""

    NAME: ClassVar[str] = "geometry"
    ACCESS: ClassVar[Access] = "r"

    wheel_radius_um: Annotated[int, Item("u32", unit="um")] = 0
    """Radius of the wheels."""
    pivot_x: Annotated[Ints, Item("i16", unit="0.1 mm")] = (0,) * ESCS
    """Position of each module's pivot, forward of the centre."""
    pivot_y: Annotated[Ints, Item("i16", unit="0.1 mm")] = (0,) * ESCS
    """Position of each module's pivot, to the left of the centre."""
    cruise_rpm: Annotated[Ints, Item("u16", unit="rpm")] = (0,) * ESCS
    """Cruising speed of each wheel."""
    max_tilt: Annotated[int, Item("u16", unit="0.01 deg")] = 0
    """Maximum tilt of the gimbals."""
    servo_steps: Annotated[int, Item("u16", unit="step")] = 0
    """Servo steps per turn."""
    speed: Annotated[int, Item("u16", unit="mm/s")] = 0
    """Speed limit."""
    turn_rate: Annotated[int, Item("u16", unit="mrad/s")] = 0
    """Turn rate limit."""
    acceleration: Annotated[int, Item("u16", unit="mm/s2")] = 0
    """Acceleration limit."""
    angular_acceleration: Annotated[int, Item("u16", unit="0.01 rad/s2")] = 0
    """Angular acceleration limit."""


@dataclass(frozen=True, slots=True)
class TripHistory(Block):
    """The last eight trips, latest first, in EEPROM; arming does not erase them."""

    NAME: ClassVar[str] = "history"
    ACCESS: ClassVar[Access] = "r"

    past_trip: Annotated[Ints, Item("u8")] = (0,) * PAST_TRIPS
    """Reasons: `Trip`; 0 if there were fewer."""
    past_start: Annotated[Ints, Item("u8")] = (0,) * PAST_TRIPS
    """Power-ups in which they occurred: the lower byte of `nonce`."""
    past_uptime_s: Annotated[Ints, Item("u16", unit="s")] = (0,) * PAST_TRIPS
    """Time since the reset, at most 65535."""
    past_lowest: Annotated[Ints, Item("u8", unit="0.1 V")] = (0,) * PAST_TRIPS
    """Lowest battery voltage since a source had got the robot; 0 if none had."""


BLOCKS: tuple[type[Block], ...] = (
    BoardIdentity,
    Setup,
    BoardCommand,
    Telemetry,
    Wheels,
    Radio,
    Geometry,
    TripHistory,
)


def _place_blocks() -> dict[str, int]:
    """Set address and layout of each block; return the address of each item and each block."""
    found: dict[str, int] = {}
    at = 0
    for block in BLOCKS:
        block.ADDRESS = found[block.NAME] = at
        layout = "<"
        for item in block.items():
            found[item.name] = block.ADDRESS + calcsize(layout)
            layout += item.layout
        block.LAYOUT = Struct(layout)
        at += block.LAYOUT.size
    return found


ADDRESS = _place_blocks()
TABLE_SIZE = sum(block.LAYOUT.size for block in BLOCKS)


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
    WHEEL = 15
    """The measured speed of a wheel is far from its throttle."""


def blinks(trip: Trip) -> tuple[int, int]:
    """Return how often the board's light blinks long, for each five of the code, and short."""
    return divmod(trip, 5)


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


class WheelSensor(IntEnum):
    """Source of the wheel speeds."""

    NONE = 0
    HALL = 1
    """One wire per wheel with pulses: a Hall sensor, or one phase of the motor."""
    TELEMETRY = 2
    """One wire per wheel with telemetry of its speed controller (KISS, BLHeli_32)."""


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
"""At or below this, a switch turns; above 1550 it turns back: receiver.c."""
