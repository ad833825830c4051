"""Steps of commissioning, as data, for each kind of machine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tsd_twin.hardware.commissioning import verdicts
from tsd_twin.hardware.commissioning.findings import Finding
from tsd_twin.hardware.commissioning.verdicts import Reading
from tsd_twin.kinematics import Joint, JointKind


@dataclass(frozen=True, slots=True)
class _Named:
    name: str
    text: str


@dataclass(frozen=True, slots=True)
class Measure(_Named):
    """A person measures a quantity and types its value."""

    unit: str
    least: float
    most: float
    hint: str


@dataclass(frozen=True, slots=True)
class Confirm(_Named):
    """A person confirms an observation."""

    hint: str


@dataclass(frozen=True, slots=True)
class Connect(_Named):
    """Connect to the robot. Gimbals within 9 deg of upright get torque and turn upright."""


@dataclass(frozen=True, slots=True)
class Watch(_Named):
    """A person prepares a state, then the robot's readings are judged."""

    verdict: Callable[[Sequence[Reading]], Finding | None]
    seconds: float = 0.5


@dataclass(frozen=True, slots=True)
class CompareBattery(_Named):
    """A person types the battery voltage, and the robot measures it."""


@dataclass(frozen=True, slots=True)
class Tilt(_Named):
    """A person pushes a gimbal by hand in its positive direction."""

    joint: int


@dataclass(frozen=True, slots=True)
class HandTurn(_Named):
    """A person turns one wheel by hand, and its sensor sends pulses."""

    wheel: int
    """Number of the wheel, from 1."""


@dataclass(frozen=True, slots=True)
class Swing(_Named):
    """The robot tilts one gimbal by 3 deg and returns it."""

    joint: int


@dataclass(frozen=True, slots=True)
class Turn(_Named):
    """The robot turns one wheel slowly."""

    joint: int
    wheel: int
    """Number of the wheel, from 1."""


Step = Measure | Confirm | Connect | Watch | CompareBattery | Tilt | HandTurn | Swing | Turn
_LONG_S = 3.0
"""Time for line errors to occur, capacitors to discharge, or ESCs to accept zero throttle."""
MOVING = (Connect, Swing, Turn)
"""Steps that may move something; a person agrees to each of them."""

_PULLED = "Motors' plugs pulled. "
_RAISED = "Wheels off the ground, nobody near"
_START = "Hold precharge for 2 s, press and release start"
_PLUG_IN = "plug in the motors, wheels off the ground, nobody near"
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
    *(
        Measure(
            name,
            "Coil unplugged from its clamp, diode test of the meter: red lead at the clamp's "
            f"{end} end, black lead where diode and Zener meet; type 9 if it shows OL",
            "V",
            0.3,
            1.5,
            f"the {part} at the coil is missing or reversed; without it the stop contacts burn",
        )
        for name, end, part in (
            ("coil_diode", "minus", "diode"),
            ("coil_zener", "plus", "Zener"),
        )
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
)
_REGULATOR: tuple[Step, ...] = (
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
        f"Regulator off. {_PULLED}{_START}. Voltage at the board's 5 V pin",
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
_COIL_SUPPLY = Confirm(
    "coil_supply",
    "Pull the fuse of the servos, and put it back: did the contactor open, and stay open?",
    "feed the coil behind the fuse of the servos, through the seal-in contact",
)


def steps_for(
    kind: str, joints: Sequence[Joint], *, receiver: bool = False, hall_sensors: bool = False
) -> tuple[Step, ...]:
    """Return the steps of a machine in their order.

    Args:
        kind: `mega`, `u2d2`, `dynamixel_wheels`, or `can`; with `+can` if the wheels of a U2D2
            robot have controllers on CAN.
        joints: Joints of the drive. Drives with gimbals have motors with plugs; other wheels are
            servos, or have a controller each that is soldered to the motor.
        receiver: Whether the calibration has a receiver.
        hall_sensors: Whether the board has a Hall sensor per wheel.
    """
    gimbals = [i for i, joint in enumerate(joints) if joint.kind is JointKind.POSITION]
    wheels = [i for i, joint in enumerate(joints) if joint.kind is JointKind.VELOCITY]
    has_board, has_can = kind in ("mega", "u2d2"), kind.endswith("can")
    has_contactor, has_plugs = has_board or has_can, bool(gimbals)
    return (
        *_SUPPLY,
        *(_CONTACTOR if has_contactor else ()),
        *(_REGULATOR if has_board else ()),
        *(_CAN if has_can else ()),
        *(() if has_board else _stop_steps(contactor=has_contactor, plugs=has_plugs)),
        _connection(kind, board=has_board, plugs=has_plugs),
        *(_board_steps(receiver=receiver) if has_board else ()),
        CompareBattery("battery", "Voltage of the battery at the robot's plug, V"),
        *_line_steps(joints, gimbals, kind),
        *(_tilt(joints, i) for i in gimbals),
        *(_hand_turn(joints, wheels) if has_board and hall_sensors else ()),
        *(_start_steps() if has_board else ()),
        Watch("faults", "Nothing touched. Press Enter to read faults", verdicts.faults, _LONG_S),
        *(_swing(joints, i) for i in gimbals),
        *_plug_steps(board=has_board, plugs=has_plugs),
        *(_turn(joints, joint, number) for number, joint in enumerate(wheels, 1)),
    )


def _connection(kind: str, *, board: bool, plugs: bool) -> Connect:
    effect = "Wheels stop" if kind == "can" else "Wheels get torque"
    ready = _RAISED
    if plugs:
        ready += ", motors' plugs pulled, contactor " + ("open" if board else "closed")
        effect = "Gimbals within 9 deg of upright get torque and turn upright"
    return Connect("connection", f"{ready}. {effect}. Connect?")


def _stop_steps(*, contactor: bool, plugs: bool) -> tuple[Step, ...]:
    """Return the test of the stop at a machine that does not measure behind it."""
    if not contactor:
        return (
            Confirm(
                "stop",
                "Power on. Press the stop: did all servos lose their power until it was released?",
                "the stop must interrupt the plus of all servos",
            ),
        )
    ready = _PULLED if plugs else f"{_RAISED}. "
    start = Confirm(
        "stop",
        f"{ready}{_START}, then press and release the stop: did power go off, and stay off?",
        "the stop must latch: seal-in contact, and a start button",
    )
    again = Confirm(
        "started",
        f"{ready}{_START} again: do all controllers have power?",
        "check the coil, the seal-in contact and the fuse of the drive",
    )
    return (start, *((_COIL_SUPPLY,) if plugs else ()), again)


def _board_steps(*, receiver: bool) -> tuple[Step, ...]:
    ready = "Press Enter to read"
    return (
        Watch("board_supply", f"Servo supply on. {ready}", verdicts.board_supply),
        Watch("drive_open", f"Contactor open, not started. {ready}", verdicts.drive_open, _LONG_S),
        *((Watch("receiver", f"Transmitter on. {ready}", verdicts.receiver),) if receiver else ()),
    )


def _line_steps(joints: Sequence[Joint], gimbals: Sequence[int], kind: str) -> tuple[Step, ...]:
    servos = gimbals or (range(len(joints)) if kind == "dynamixel_wheels" else ())
    names = [joints[i].name for i in servos]
    text = "Shake all plugs by hand meanwhile. Press Enter to read"
    wheels = [joint.name for joint in joints if joint.kind is JointKind.VELOCITY]
    read = "Press Enter to read the"
    return (
        *((Watch("servos", f"{read} servos", verdicts.servos(names)),) if names else ()),
        *(
            (Watch("controllers", f"{read} controllers", verdicts.controllers(wheels)),)
            if kind.endswith("can")
            else ()
        ),
        Watch("line", text, verdicts.line, _LONG_S),
        Watch("warnings", "Press Enter to read warnings", verdicts.warnings),
    )


def _start_steps() -> tuple[Step, ...]:
    return (
        Watch("start", f"{_PULLED}{_START}, then Enter", verdicts.drive_closed),
        Watch(
            "stop_opens",
            "Press and release the hard-wired stop. Do not press start. Then Enter",
            verdicts.drive_open,
            _LONG_S,
        ),
        _COIL_SUPPLY,
        Confirm(
            "esc_zero",
            "Calibrate each ESC with a servo tester in place of the board: full throttle, ESC on, "
            "beeps, zero throttle, beep. Reconnect and start: does each ESC beep once for zero?",
            "stop here: an ESC that misses zero at 1000 us may spin its motor while disarmed",
        ),
        Watch("started", f"{_PULLED}Start again, then Enter", verdicts.drive_closed),
    )


def _plug_steps(*, board: bool, plugs: bool) -> tuple[Step, ...]:
    """Return how motors are plugged in, after all else is proven and without power."""
    if board:
        return (
            Watch(
                "plugged",
                f"Press and release the hard-wired stop. Then {_PLUG_IN}. Then Enter",
                verdicts.drive_open,
                _LONG_S,
            ),
            Watch("restarted", "Start again, then Enter", verdicts.drive_closed),
        )
    if plugs:
        return (
            Watch(
                "plugged",
                f"Press and release the stop. Then {_PLUG_IN}. Start again, then Enter",
                verdicts.faults,
                _LONG_S,
            ),
        )
    return ()


def _tilt(joints: Sequence[Joint], i: int) -> Step:
    name = joints[i].name
    return Tilt(
        f"tilt_{name}",
        f"Push {name} by hand in its positive direction (arrow of the drawing), hold it, then "
        "Enter",
        i,
    )


def _hand_turn(joints: Sequence[Joint], wheels: Sequence[int]) -> tuple[Step, ...]:
    return tuple(
        HandTurn(
            f"sensor_{joints[i].name}",
            f"Press Enter, then turn wheel {number} ({joints[i].name}) by hand for 5 s, by two "
            "turns or more, and no other wheel",
            number,
        )
        for number, i in enumerate(wheels, 1)
    )


def _swing(joints: Sequence[Joint], i: int) -> Step:
    name = joints[i].name
    return Swing(f"swing_{name}", f"{name} tilts by 3 deg and returns", i)


def _turn(joints: Sequence[Joint], joint: int, number: int) -> Step:
    name = joints[joint].name
    text = f"Wheels off the ground. Wheel {number} ({name}) turns slowly"
    return Turn(f"turn_{name}", text, joint, number)
