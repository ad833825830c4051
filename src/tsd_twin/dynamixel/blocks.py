"""Blocks of the control table as values; made by `python -m tsd_twin.dynamixel`, do not edit."""

from __future__ import annotations

from dataclasses import dataclass
from struct import Struct
from typing import ClassVar

from tsd_twin.dynamixel.packets import Packed


@dataclass(frozen=True, slots=True)
class Identity(Packed):
    """Identity of the board, and fixed parameters."""

    ADDRESS: ClassVar[int] = 0
    LAYOUT: ClassVar[Struct] = Struct("<HBBBIIHHHHB")

    model: int = 2014
    """Kind of board."""
    fw: int = 5
    """Version of the firmware, as a ping answers it."""
    table_version: int = 5
    """Version of this table."""
    id: int = 200
    """Id on the wire."""
    host_baud: int = 1000000
    """Rate of the line to the PC [Bd]."""
    servo_baud: int = 1000000
    """Rate of the servo bus [Bd]."""
    heartbeat_timeout_ms: int = 500
    """Trips after this without a beat [ms]."""
    watchdog_ms: int = 250
    """A hung firmware is reset after this [ms]."""
    esc_hold_ms: int = 2000
    """Zero throttle before arming [ms]."""
    neutral_band: int = 11
    """Neutral is within this [step]."""
    servo_hot_c: int = 75
    """A servo this hot does not arm, and trips [deg C]."""


@dataclass(frozen=True, slots=True)
class Setup(Packed):
    """Parameters of the robot; kept without power. Written as a whole, 2 s after a throttle."""

    ADDRESS: ClassVar[int] = 22
    LAYOUT: ClassVar[Struct] = Struct("<6B6HBHBHHHB4H4H4HBBI3H3H3HH")

    servo_id: tuple[int, ...] = (1, 2, 3, 4, 5, 6)
    """Id of each servo, all different: alpha and beta of module 1, then 2, then 3."""
    neutral: tuple[int, ...] = (2048,) * 6
    """Servo position of neutral [step]."""
    reverse: int = 0
    """Bit i: servo i turns the other way."""
    goal_limit: int = 341
    """Goals are held within ± this [step]."""
    servos_expected: int = 63
    """Bit i: servo i must answer to arm and to stay armed; 0 when others drive the servos."""
    battery_arm_mv: int = 0
    """No arming below this [mV]."""
    battery_stop_mv: int = 0
    """Trips below this for 1 s [mV]."""
    bandgap_mv: int = 1100
    """Of the chip's bandgap, which its supply is measured against [mV]."""
    receiver_expected: int = 0
    """1: a receiver must be there to arm and stay armed, though none was seen since power came."""
    stick_low: tuple[int, ...] = (1100,) * 4
    """Pulse at the low end of forward, left, turn, speed [us]."""
    stick_centre: tuple[int, ...] = (1500,) * 4
    """At rest; of the speed unused [us]."""
    stick_high: tuple[int, ...] = (1900,) * 4
    """At the high end [us]."""
    stick_dead: int = 20
    """Dead band at the centre, and at both ends [us]."""
    receiver_kind: int = 0
    """What the receiver sends: `ReceiverKind`."""
    receiver_map: int = 5517840
    """Channel of forward, left, turn, speed, kill, manual: 4 bits each, from the lowest."""
    pulse_low: tuple[int, ...] = (2000,) * 3
    """Pulse of zero throttle of each speed controller; another only without power at them [0.5
    us].
    """
    pulse_high: tuple[int, ...] = (4000,) * 3
    """Of full throttle [0.5 us]."""
    throttle_limit: tuple[int, ...] = (4000,) * 3
    """No throttle exceeds this, whatever the source."""
    throttle_rise: int = 2000
    """Most by which a throttle rises in 10 ms; it falls at once."""


@dataclass(frozen=True, slots=True)
class Command(Packed):
    """Joint commands: one WRITE of the whole block in each cycle; a partial one is error 5."""

    ADDRESS: ClassVar[int] = 101
    LAYOUT: ClassVar[Struct] = Struct("<HBB3H6h2H")

    heartbeat: int = 0
    """A change is a beat; arming needs one. While armed, a block that is behind is error 7."""
    arm: int = 0
    """Going from 0 to 1 arms, unless there is a reason to refuse; 0 disarms. After a trip it has
    to be written 0 first: 1 again and again never arms again. 2 is STOP, for the radio control
    too: until a 0 of this session no source gets the robot.
    """
    torque: int = 1
    """0 switches servo torque off, while disarmed only."""
    throttle: tuple[int, ...] = (2000,) * 3
    """Of each speed controller, from `pulse_low` at 2000 to `pulse_high` at 4000; put out while
    armed.
    """
    goal: tuple[int, ...] = (0,) * 6
    """Gimbals from neutral: alpha and beta of module 1, then 2, then 3; obeyed while armed [step].
    """
    session: tuple[int, ...] = (0,) * 2
    """As `nonce`, or the block only disarms or stops: with `arm` 1 it is error 7."""


@dataclass(frozen=True, slots=True)
class Telemetry(Packed):
    """Measurements and states: one READ in each cycle."""

    ADDRESS: ClassVar[int] = 127
    LAYOUT: ClassVar[Struct] = Struct("<IBBBBH2HBBBBBBBBBBBI3H6h6h6h6B6B6HHHHHHHHHHBBB6H6B")

    millis: int = 0
    """Since the reset [ms]."""
    mode: int = 0
    """Source of the joint commands: `BoardMode`."""
    trip: int = 0
    """Why the board last disarmed itself, until it arms: `Trip`."""
    refusal: int = 0
    """Why arming was last refused: `Refusal`."""
    reset_cause: int = 0
    """Why the board started: `ResetCause`."""
    beat: int = 0
    """Echo of the heartbeat that was written last."""
    nonce: tuple[int, ...] = (0,) * 2
    """Number of this session; another after each start, each disarming, and each 1 in `arm` that
    does not arm.
    """
    setup_known: int = 0
    """1: the setup was written, now or before."""
    drive_on: int = 0
    """1: the speed controllers have power, behind the contactor."""
    esc_ready: int = 0
    """1: zero throttle was put out for `esc_hold_ms`, since the speed controllers got power and
    since the last disarming.
    """
    servo_found: int = 0
    """Bit i: servo i answered a ping."""
    servo_alive: int = 0
    """Bit i: servo i answered within the last 50 ms."""
    servo_protocol: int = 0
    """Bit i: servo i speaks Protocol 2.0, else 1.0."""
    servo_fault: int = 0
    """Bit i: servo i reports a hardware error."""
    servo_torque: int = 0
    """Bit i: servo i said within the last 150 ms that it holds."""
    servo_checked: int = 0
    """Bit i: the settings of servo i have the required values."""
    wrong_servo: int = 0
    """Number, from 1, of a servo with a wrong setting, which the next two name; 0: none."""
    wrong_register: int = 0
    """Its address in the table of the servo; 0: its model."""
    wrong_value: int = 0
    """What it is there."""
    throttle_out: tuple[int, ...] = (2000,) * 3
    """Throttle that is put out."""
    position: tuple[int, ...] = (0,) * 6
    """Gimbals from neutral [step]."""
    velocity: tuple[int, ...] = (0,) * 6
    """Gimbals [step/s]."""
    current: tuple[int, ...] = (0,) * 6
    """Of the servos [mA]."""
    voltage: tuple[int, ...] = (0,) * 6
    """At the servos [0.1 V]."""
    temperature: tuple[int, ...] = (0,) * 6
    """Of the servos [deg C]."""
    rc: tuple[int, ...] = (0,) * 6
    """Pulses of the receiver: forward, left, turn, speed, kill, manual; 0: no pulses [us]."""
    battery_mv: int = 0
    """Of the battery [mV]."""
    drive_mv: int = 0
    """Of the speed controllers, behind the contactor [mV]."""
    supply_mv: int = 0
    """Of the board; the reference of the other two [mV]."""
    crc_errors: int = 0
    """Packets from the PC with a wrong sum."""
    rx_errors: int = 0
    """Bytes from the PC lost, or cut packets given up."""
    servo_errors: int = 0
    """Answers of servos that were missing or wrong."""
    overruns: int = 0
    """Cycles that took longer than 10 ms."""
    trips: int = 0
    """Times that the board disarmed itself since power came."""
    resets: int = 0
    """Resets since power came."""
    stop_proven: int = 0
    """1: the stop circuit was seen open since power came."""
    servo_far: int = 0
    """Bit i: servo i was not within 100 steps of its `neutral` yet, since power came or `neutral`
    changed: it gets no torque.
    """
    servo_stuck: int = 0
    """Bit i: servo i did not follow its goal, at the last trip."""
    servo_model: tuple[int, ...] = (0,) * 6
    """Model numbers of the servos; 0: not read."""
    servo_missed: tuple[int, ...] = (0,) * 6
    """Missing or wrong answers of each servo; from 255 on to 0."""


@dataclass(frozen=True, slots=True)
class Radio(Packed):
    """All that receivers of either kind send: for their set-up."""

    ADDRESS: ClassVar[int] = 261
    LAYOUT: ClassVar[Struct] = Struct("<22H")

    channel: tuple[int, ...] = (0,) * 22
    """The channels of a frame, then the pulses of the wires; 0: none [us]."""
