"""Steps of commissioning, as data, for each kind of machine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tsd_twin.hardware.commissioning import verdicts
from tsd_twin.hardware.commissioning.findings import Finding
from tsd_twin.hardware.commissioning.verdicts import Reading
from tsd_twin.kinematics import Joint, JointKind


@dataclass(frozen=True, slots=True)
class Measure:
    """A person measures a quantity and types its value."""

    name: str
    text: str
    unit: str
    least: float
    most: float
    hint: str


@dataclass(frozen=True, slots=True)
class Confirm:
    """A person confirms an observation."""

    name: str
    text: str
    hint: str


@dataclass(frozen=True, slots=True)
class Connect:
    """Connect to the robot. Gimbals within 9 deg of upright get torque and turn upright."""

    name: str
    text: str


@dataclass(frozen=True, slots=True)
class Watch:
    """A person prepares a state, then the robot's readings are judged."""

    name: str
    text: str
    verdict: Callable[[Sequence[Reading]], Finding | None]


@dataclass(frozen=True, slots=True)
class CompareBattery:
    """A person types the battery voltage, and the robot measures it."""

    name: str
    text: str


@dataclass(frozen=True, slots=True)
class Tilt:
    """A person pushes a gimbal by hand in its positive direction."""

    name: str
    text: str
    joint: int


@dataclass(frozen=True, slots=True)
class Swing:
    """The robot tilts one gimbal by 3 deg and returns it."""

    name: str
    text: str
    joint: int


@dataclass(frozen=True, slots=True)
class Turn:
    """The robot turns one wheel slowly."""

    name: str
    text: str
    joint: int
    wheel: int
    """Number of the wheel, from 1."""


Step = Measure | Confirm | Connect | Watch | CompareBattery | Tilt | Swing | Turn
MOVING = (Connect, Swing, Turn)
"""Steps that may move something; a person agrees to each of them."""

_SUPPLY: tuple[Step, ...] = (
    Measure(
        "short_circuit",
        "All power off, main fuse out, contactor open. Resistance from + to - behind the main fuse",
        "ohm",
        500.0,
        10e6,
        "a short circuit, or a reversed capacitor or diode",
    ),
    Measure(
        "polarity",
        "Battery in, main fuse out. Voltage from + (red) to - (black) at the fuse holder",
        "V",
        9.0,
        30.0,
        "reversed polarity or an empty battery",
    ),
)
_CONTACTOR: tuple[Step, ...] = (
    Measure(
        "coil_diode",
        "Coil unplugged from the supply, diode test of the meter, red lead at the coil's minus and "
        "black at its plus; type 9 if it shows OL",
        "V",
        0.3,
        1.5,
        "diode and Zener at the coil are missing or reversed; without them the stop contacts burn",
    ),
    Measure(
        "precharge",
        "Contactor open. Resistance from the fuse of the drive to the contactor's output, with the "
        "precharge button pressed",
        "ohm",
        10.0,
        47.0,
        "precharge resistor missing or wrong; its absence welds the contacts",
    ),
    Measure(
        "regulator",
        "Main fuse in, contactor open, board's 5 V wire off. Voltage of the one BEC or regulator",
        "V",
        4.9,
        5.25,
        "wrong regulator; more than 5.5 V destroys the board",
    ),
    Measure(
        "second_supply",
        "Regulator off, contactor closed, motors' plugs pulled. Voltage at the board's 5 V pin",
        "V",
        -0.2,
        0.5,
        "a second BEC feeds the board: cut the red wire in each ESC plug",
    ),
    Confirm(
        "usb_supply",
        "Battery off, USB in: are all lights of the board dark?",
        "USB feeds the board: cut its 5 V wire",
    ),
    Measure(
        "sbus_level",
        "Receiver on, transmitter off. Mean voltage at D15; type 5 without an SBUS receiver",
        "V",
        3.0,
        5.25,
        "SBUS at D15 must idle at 5 V: it needs an inverter",
    ),
)
_CAN: tuple[Step, ...] = (
    Measure(
        "termination",
        "Power off. Resistance from CAN high to CAN low",
        "ohm",
        54.0,
        66.0,
        "120 ohm belong at both ends of the bus, and nowhere else",
    ),
)
_AFTER_START: tuple[Step, ...] = (
    Confirm(
        "coil_supply",
        "Pull the fuse of the servos, and put it back: did the contactor open, and stay open?",
        "feed the coil behind the fuse of the servos, through the seal-in contact",
    ),
)


def steps_for(kind: str, joints: Sequence[Joint], *, receiver: bool = False) -> tuple[Step, ...]:
    """Return the steps of a machine in their order.

    Args:
        kind: `mega`, `u2d2`, `dynamixel_wheels`, or `can`; with `+can` if the wheels of a U2D2
            robot have controllers on CAN.
        joints: Joints of the drive.
        receiver: Whether the calibration has a receiver.
    """
    gimbals = [i for i, joint in enumerate(joints) if joint.kind is JointKind.POSITION]
    wheels = [i for i, joint in enumerate(joints) if joint.kind is JointKind.VELOCITY]
    has_board = kind in ("mega", "u2d2")
    before = _SUPPLY + (_CONTACTOR if has_board else _CAN if kind.endswith("can") else ())
    connect = Connect(
        "connection",
        "Wheels off the ground, motors' plugs pulled, contactor open. Connect? Gimbals within "
        "9 deg of upright get torque and turn upright"
        if has_board
        else "Wheels off the ground, nobody near. Connect? Wheels and gimbals get torque; gimbals "
        "within 9 deg of upright turn upright",
    )
    return (
        *before,
        connect,
        *(_board_steps(receiver=receiver) if has_board else ()),
        CompareBattery("battery", "Voltage of the battery at the robot's plug, V"),
        *_line_steps(joints, gimbals, kind),
        *(_tilt(joints, i) for i in gimbals),
        *(_start_steps() if has_board else ()),
        Watch("faults", "Nothing touched. Press Enter to read faults", verdicts.faults),
        *(_swing(joints, i) for i in gimbals),
        *_wheel_steps(joints, wheels, plugs=has_board),
        Confirm(
            "stop",
            "Press the hard-wired stop, then release it: did power go off, and stay off until the "
            "start button?",
            "the stop must latch: seal-in contact, and a start button",
        ),
    )


def _board_steps(*, receiver: bool) -> tuple[Step, ...]:
    ready = "Press Enter to read"
    return (
        Watch("board_supply", f"Servo supply on. {ready}", verdicts.board_supply),
        Watch("drive_open", f"Contactor open, not started. {ready}", verdicts.drive_open),
        *((Watch("receiver", f"Transmitter on. {ready}", verdicts.receiver),) if receiver else ()),
    )


def _line_steps(joints: Sequence[Joint], gimbals: Sequence[int], kind: str) -> tuple[Step, ...]:
    servos = gimbals or (range(len(joints)) if kind == "dynamixel_wheels" else ())
    names = [joints[i].name for i in servos]
    text = "Shake all plugs by hand meanwhile. Press Enter to read"
    wheels = [joint.name for joint in joints if joint.kind is JointKind.VELOCITY]
    return (
        Watch("servos", "Press Enter to read the servos", verdicts.servos(names)),
        Watch("controllers", "Press Enter to read the controllers", verdicts.controllers(wheels)),
        Watch("line", text, verdicts.line),
        Watch("warnings", "Press Enter to read warnings", verdicts.warnings),
    )


def _start_steps() -> tuple[Step, ...]:
    return (
        Watch(
            "start",
            "Motors' plugs pulled. Hold precharge for 2 s, press and release start, then Enter",
            verdicts.drive_closed,
        ),
        Watch(
            "stop_opens",
            "Press and release the hard-wired stop. Do not press start. Then Enter",
            verdicts.drive_open,
        ),
        *_AFTER_START,
        Confirm(
            "esc_zero",
            "Calibrate each ESC with a servo tester in place of the board: full throttle, ESC on, "
            "beeps, zero throttle, beep. Reconnect and start: does each ESC beep once for zero?",
            "stop here: an ESC that misses zero at 1000 us may spin its motor while disarmed",
        ),
        Watch("started", "Start again, then Enter", verdicts.drive_closed),
    )


def _tilt(joints: Sequence[Joint], i: int) -> Step:
    name = joints[i].name
    return Tilt(
        f"tilt_{name}",
        f"Push {name} by hand in its positive direction (arrow of the drawing), hold it, then "
        "Enter",
        i,
    )


def _swing(joints: Sequence[Joint], i: int) -> Step:
    name = joints[i].name
    return Swing(f"swing_{name}", f"{name} tilts by 3 deg and returns", i)


def _wheel_steps(joints: Sequence[Joint], wheels: Sequence[int], *, plugs: bool) -> list[Step]:
    first = "Motors' plugs in, wheels off the ground. " if plugs else "Wheels off the ground. "
    return [
        Turn(
            f"turn_{joints[joint].name}",
            f"{first}Wheel {number} ({joints[joint].name}) turns slowly",
            joint,
            number,
        )
        for number, joint in enumerate(wheels, 1)
    ]
