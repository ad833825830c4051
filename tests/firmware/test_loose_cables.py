"""Loose cables, injected one at a time: the sentence names the right one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tests.support.firmware_host import Bench, FirmwareHost
from tests.support.wheel_matrix import WheelRig
from tsd_twin.hardware.cables import BoardCables
from tsd_twin.hardware.dynamixel.control_table import Setup
from tsd_twin.hardware.joints import ServoNames
from tsd_twin.messages.codes import Code, Reason

TSD = ServoNames([f"module{i}_{angle}" for i in (1, 2, 3) for angle in ("alpha", "beta")])
CONTACTS = 12
"""How often the contact opens."""
GAP_S, PERIOD_S = 0.03, 0.3
RIGHT = 18


@dataclass(frozen=True)
class Loose:
    """A loose cable of the robot with the board."""

    what: str
    open_contact: Callable[[FirmwareHost], object]
    close_contact: Callable[[FirmwareHost], object]
    code: Code
    servos: str = ""


def _dead(mask: int, *, dead: bool) -> Callable[[FirmwareHost], object]:
    def act(pilot: FirmwareHost) -> None:
        for i, servo in enumerate(pilot.simulation.servos):
            if mask >> i & 1:
                servo.dead = dead

    return act


def _data(mask: int, what: str, code: Code) -> Loose:
    return Loose(what, _dead(mask, dead=True), _dead(mask, dead=False), code, TSD.named(mask))


def _power(mask: int, what: str) -> Loose:
    def cut(pilot: FirmwareHost) -> None:
        for i, servo in enumerate(pilot.simulation.servos):
            if mask >> i & 1:
                servo.dead = True
                servo.restart()

    return Loose(what, cut, _dead(mask, dead=False), Code.CABLE_SUPPLY, TSD.named(mask))


def _wires(*channels: int) -> Loose:
    names = ("forward", "left", "turn", "speed", "kill", "manual")
    return Loose(
        f"receiver wire {channels}",
        lambda pilot: pilot.simulation.lose_receiver(*channels),
        lambda pilot: pilot.simulation.board.set_receiver(pilot.simulation.receiver_us),
        Code.CABLE_RECEIVER,
        ", ".join(names[i] for i in channels),
    )


OF_THE_BOARD = (
    *(_data(1 << i, f"plug of servo {i + 1}", Code.CABLE_PLUG) for i in range(6)),
    _data(0b111100, "data wire to module 2", Code.CABLE_WIRE),
    _data(0b110000, "data wire to module 3", Code.CABLE_WIRE),
    _data(0b111111, "data wire of the bus", Code.CABLE_BUS),
    *(_power(0b11 << 2 * i, f"supply of branch {i + 1}") for i in range(3)),
    Loose(
        "fuse of the servos",
        lambda pilot: pilot.simulation.set_servo_fuse(whole=False),
        lambda pilot: pilot.simulation.set_servo_fuse(whole=True),
        Code.CABLE_SUPPLY,
        TSD.named(0b111111),
    ),
    _wires(0),
    _wires(4),
    _wires(5),
)
"""16 of 20."""


def told_by_the_board(bench: Bench, loose: Loose) -> list[Reason]:
    """Return the findings after some openings of a contact of the robot with the board."""
    pilot = bench.pilot(receiver=True)
    pilot.get_ready(Setup())
    cables, now_s, before = BoardCables(TSD, TSD.servos), 0.0, pilot.telemetry()

    def watch(seconds: float) -> None:
        nonlocal now_s, before
        end_s = now_s + seconds
        while now_s < end_s - 1e-6:
            if pilot.simulation.power.servo_fuse:
                pilot.cycle(0)
                board = pilot.telemetry()
                cables.add(before, board, now_s)
                before = board
            else:
                pilot.simulation.run(0.01)
            now_s += 0.01

    watch(0.3)
    for _ in range(CONTACTS):
        loose.open_contact(pilot)
        # SBUS and pulses count as missing after 0.1 s; a servo after its next cycle.
        watch(0.15 if loose.code is Code.CABLE_RECEIVER else GAP_S)
        loose.close_contact(pilot)
        watch(PERIOD_S)
    return cables.monitor.findings()


def told_by_the_bridge(
    open_contact: Callable[[WheelRig], object], close_contact: Callable[[WheelRig], object]
) -> list[Reason]:
    """Return the findings of a robot whose wheels are servos on a bus."""
    rig = WheelRig("kiwi")
    rig.run(0.3)
    for _ in range(CONTACTS):
        open_contact(rig)
        rig.run(GAP_S)
        close_contact(rig)
        rig.run(PERIOD_S)
    return rig.bus.cables.findings()


def _spoil(rig: WheelRig, bits: int) -> None:
    rig.line.bus.spoil_bits = bits


def _cut(rig: WheelRig, i: int) -> None:
    rig.servos[i].set_power(False)


def _dip(rig: WheelRig, volts: float) -> None:
    for servo in rig.servos[1:]:
        servo.volts = volts


def _plug(rig: WheelRig, *, there: bool) -> None:
    rig.line.plugged = there


Act = Callable[[WheelRig], object]
OF_THE_BUS: tuple[tuple[str, Act, Act, Code, str], ...] = (
    ("ground of the data wire", lambda r: _spoil(r, 8), lambda r: _spoil(r, 0),
     Code.CABLE_GROUND, ""),
    ("supply of wheel 3", lambda r: _cut(r, 2), lambda r: r.servos[2].set_power(True),
     Code.CABLE_SUPPLY, "3 (wheel3)"),
    ("supply that sags behind wheel 1", lambda r: _dip(r, 8.0), lambda r: _dip(r, 11.1),
     Code.CABLE_SUPPLY, "2 (wheel2), 3 (wheel3)"),
    ("USB plug", lambda r: _plug(r, there=False), lambda r: _plug(r, there=True),
     Code.CABLE_LINE, ""),
)  # fmt: skip


def test_eighteen_of_twenty_loose_cables_are_named(native_bench: Bench) -> None:
    wrong: list[object] = []
    for loose in OF_THE_BOARD:
        found = told_by_the_board(native_bench, loose)
        named = found[0].params.get("servos", found[0].params.get("channels", "")) if found else ""
        of_all = loose.code is Code.CABLE_BUS
        if not found or found[0].code != loose.code or (named != loose.servos and not of_all):
            wrong.append((loose.what, found))
    for what, open_contact, close_contact, code, servos in OF_THE_BUS:
        found = told_by_the_bridge(open_contact, close_contact)
        right = found and found[0].code == code
        if not right or (servos and found[0].params["servos"] != servos):
            wrong.append((what, found))
    count = len(OF_THE_BOARD) + len(OF_THE_BUS)
    assert count == 20
    assert count - len(wrong) >= RIGHT, wrong


def test_a_robot_with_sound_cables_is_told_nothing(native_bench: Bench) -> None:
    nothing = Loose("nothing", lambda _: None, lambda _: None, Code.CABLE_BUS)
    assert not told_by_the_board(native_bench, nothing)
    assert not told_by_the_bridge(lambda _: None, lambda _: None)
