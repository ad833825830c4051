"""Cycle of the servos, judged by the packets on their bus and their times.

These tests run without the chip: the program takes no time, so a time is the end of the last byte.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import pytest

from firmware.simulator import protocol1, protocol2
from firmware.simulator.mx64 import Mx64
from firmware.simulator.servo_bus import ServoBusSimulation
from tests.support.firmware_host import (
    CRUISE,
    CYCLE_S,
    MODEL,
    Bench,
    FirmwareHost,
    number,
    run_until,
    write,
)
from tsd_twin.hardware.dynamixel.control_table import Setup
from tsd_twin.hardware.dynamixel.servo_models import span

BYTE_S = 1e-5
MIXED = (1, 2, 1, 2, 2, 1)
GOALS, PING, MOVING, STATE, TORQUE, SETTING, TELL = (
    "goals", "ping", "moving", "state", "torque", "setting", "tell",
)  # fmt: skip
KINDS = {
    1: {(34, 10): MOVING, (68, 2): STATE, (24, 1): TORQUE},
    2: {(128, 8): MOVING, (126, 21): STATE, (64, 1): TORQUE},
}


@dataclass(frozen=True)
class Request:
    """Packets of the board on the bus."""

    begin_s: float
    end_s: float
    """When the answer ended, or without one the request itself."""
    version: int
    kind: str
    servo: int
    """From 1; 0 for all."""
    value: object = None
    """Address and size of a setting; torque; goals by servo."""
    answered: bool = False


def reads(version: int) -> list[tuple[int, int]]:
    """Address and size of each read of settings, in their order."""
    return [(group[0].address, span(group)) for group in MODEL[version].reads()]


Change = Callable[[str, int, bytes], bytes | None]


class Listener(ServoBusSimulation):
    """The servos of a robot, with a record of what they were asked."""

    def __init__(self, pilot: FirmwareHost) -> None:
        super().__init__(pilot.simulation.servos)
        self.heard: list[Request] = []
        self.change: Change = lambda _kind, _servo, answer: answer
        """Takes what is asked, the servo, and its answer; returns the one that it sends."""
        self._board = pilot.simulation.board
        pilot.simulation.servo_bus = self

    def answer(self, request: bytes) -> tuple[bytes, int] | None:
        reply = super().answer(request)
        version = 2 if request[:4] == b"\xff\xff\xfd\x00" else 1
        kind, servo, value = understood(request, version)
        if reply is not None:
            changed = self.change(kind, servo, reply[0])
            reply = None if changed is None else (changed, reply[1])
        now_s = self._board.now_s
        took_s = 0.0 if reply is None else 1e-6 * reply[1] + BYTE_S * len(reply[0])
        begin_s = now_s - BYTE_S * len(request)
        self.heard.append(
            Request(begin_s, now_s + took_s, version, kind, servo, value, reply is not None)
        )
        return reply

    def kinds(self, kind: str) -> list[Request]:
        """Requests of one kind."""
        return [it for it in self.heard if it.kind == kind]


def understood(request: bytes, version: int) -> tuple[str, int, object]:
    """Kind, servo and value of a request."""
    protocol = protocol2 if version == 2 else protocol1
    parsed = protocol.parse(request)
    assert parsed is not None, request.hex()
    servo, instruction, parameters = parsed
    if instruction == protocol.PING:
        return PING, servo, None
    address, rest = protocol.fields(parameters)
    if instruction == protocol.READ:
        what = (address, int.from_bytes(rest, "little"))
        kind = KINDS[version].get(what, SETTING)
        return kind, servo, what if kind == SETTING else None
    if instruction == protocol.WRITE:
        assert address == (64 if version == 2 else 24)
        return TELL, servo, int.from_bytes(rest, "little")
    assert instruction == protocol.SYNC_WRITE
    assert (servo, address) == (0xFE, 116 if version == 2 else 30)
    size = 4 if version == 2 else 2
    assert int.from_bytes(rest[:version], "little") == size
    rest = rest[version:]
    goals = {
        rest[at]: int.from_bytes(rest[at + 1 : at + 1 + size], "little")
        for at in range(0, len(rest), size + 1)
    }
    return GOALS, 0, goals


def versions_of(version: int | Sequence[int]) -> list[int]:
    return [version] * 6 if isinstance(version, int) else list(version)


def cycles(heard: Sequence[Request]) -> list[list[Request]]:
    """Whole cycles of 10 ms, one after the other."""
    found: dict[int, list[Request]] = {}
    for it in heard:
        found.setdefault(int(it.begin_s / CYCLE_S), []).append(it)
    numbers = list(found)[1:-1]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers))), "none is left out"
    return [found[number] for number in numbers]


def check_cycle(cycle: Sequence[Request], versions: Sequence[int], *, goals: bool) -> None:
    """Goals of either protocol, six positions, one request more: each right after the other."""
    expected: list[tuple[str, int]] = []
    if goals:
        expected += [(GOALS, version) for version in (2, 1) if version in versions]
    expected += [(MOVING, version) for version in versions]
    assert [(it.kind, it.version) for it in cycle[:-1]] == expected
    assert [it.servo for it in cycle if it.kind == MOVING] == [1, 2, 3, 4, 5, 6]
    for it in cycle:
        if it.kind == GOALS:
            assert isinstance(it.value, dict)
            assert list(it.value) == [i + 1 for i in range(6) if versions[i] == it.version]
    assert cycle[0].begin_s % CYCLE_S < 0.00102, "in the millisecond in which it is due"
    for one, other in pairwise(cycle):
        assert other.begin_s - one.end_s == pytest.approx(0.0, abs=2e-6)


def listened(pilot: FirmwareHost, seconds: float) -> list[list[Request]]:
    """Let time pass; return the cycles of it."""
    pilot.simulation.servo_bus = bus = Listener(pilot)
    pilot.simulation.run(seconds)
    return cycles(bus.heard)


def successors(values: Sequence[int]) -> set[int]:
    """How far each is behind the one before, around six."""
    return {(other - one) % 6 for one, other in pairwise(values)}


def check_settings(asked: Sequence[Request], versions: Sequence[int]) -> None:
    """All settings of each servo, again and again, in their order."""
    for servo in range(1, 7):
        listed = reads(versions[servo - 1])
        read = [it.value for it in asked if it.servo == servo]
        start = listed.index(read[0])  # type: ignore[arg-type]
        assert read == [listed[(start + i) % len(listed)] for i in range(len(read))]
        assert len(read) > len(listed)


def test_each_cycle_has_goals_positions_and_one_request_more(native_bench: Bench) -> None:
    for version in (1, 2, MIXED):
        versions = versions_of(version)
        pilot = native_bench.pilot(version)
        pilot.simulation.run(2.0)  # All is checked.
        for goals in (False, True):
            found = listened(pilot, 2.5)
            for cycle in found:
                check_cycle(cycle, versions, goals=goals)
            more = [cycle[-1] for cycle in found]
            torque, others = more[::2], more[1::2]
            if more[0].kind != TORQUE:
                torque, others = others, torque
            assert {it.kind for it in torque} == {TORQUE}
            assert successors([it.servo for it in torque]) == {1}
            assert {it.kind for it in others} == {SETTING, STATE}
            state = [i for i, it in enumerate(others) if it.kind == STATE]
            assert {other - one for one, other in pairwise(state)} == {4}
            assert successors([others[i].servo for i in state]) == {1}
            asked = [it for it in others if it.kind == SETTING]
            assert successors([it.servo for it in asked]) == {1}
            check_settings(asked, versions)
            if not goals:
                pilot.get_ready()


def test_torque_is_asked_for_in_six_of_seven_cycles_while_armed(native_bench: Bench) -> None:
    for version in (1, 2, MIXED):
        pilot = native_bench.pilot(version).get_driving()
        bus = Listener(pilot)
        for cycle in range(150):
            pilot.cycle(1, CRUISE, (cycle % 20,) * 6)
        found = cycles(bus.heard)
        for cycle in found:
            assert [it.kind for it in cycle if it.kind not in (GOALS, MOVING)] == [cycle[-1].kind]
        more = [cycle[-1] for cycle in found]
        state = [i for i, it in enumerate(more) if it.kind == STATE]
        assert {other - one for one, other in pairwise(state)} == {7}
        assert successors([more[i].servo for i in state]) == {1}
        torque = [it for it in more if it.kind != STATE]
        assert {it.kind for it in torque} == {TORQUE}
        assert successors([it.servo for it in torque]) == {1}


def last_ms(bus: Listener, kind: str, servo: int) -> int:
    """The millisecond of the board in which an answer ended last."""
    return int(1000 * [it.end_s for it in bus.kinds(kind) if it.servo == servo and it.answered][-1])


def run_until_read(
    pilot: FirmwareHost, bus: Listener, servo: int, setting: tuple[int, int]
) -> None:
    """Run until a setting of a servo has been read."""
    bus.heard.clear()
    board = pilot.simulation.board
    for _ in range(10000):
        read = [it for it in bus.kinds(SETTING) if (it.servo, it.value) == (servo, setting)]
        if read and board.now_s > read[0].end_s:
            return
        pilot.simulation.run(0.0002)
    raise AssertionError("never")


def test_missing_servos_are_looked_for_one_in_each_cycle_in_both_protocols(
    native_bench: Bench,
) -> None:
    for version, missing in ((2, (2, 5)), (1, (1, 6)), (MIXED, (1, 2, 3, 4, 5, 6)), (2, (4,))):
        pilot = native_bench.pilot(version)
        for servo in missing:
            pilot.simulation.servos[servo - 1].dead = True
        pilot.get_ready()
        pilot.simulation.run(0.5)
        found = listened(pilot, 0.6)
        pings = [[(it.servo, it.version) for it in cycle if it.kind == PING] for cycle in found]
        assert {len(it) for it in pings} == {1}
        order = [(servo, version) for servo in missing for version in (2, 1)]
        start = order.index(pings[0][0])
        assert [it for (it,) in pings] == [
            order[(start + i) % len(order)] for i in range(len(pings))
        ]
        torque: list[int] = []
        for cycle in found:
            assert cycle[0].begin_s % CYCLE_S < 0.00102
            assert [it.servo for it in cycle if it.kind in (PING, MOVING)] == sorted(
                {it.servo for it in cycle if it.kind in (PING, MOVING)}
            )
            assert {it.servo for it in cycle if it.kind == MOVING} == set(range(1, 7)) - {*missing}
            assert not {it.servo for it in cycle if it.kind != PING} & {*missing}
            goals = [it.value for it in cycle if it.kind == GOALS]
            assert len(goals) == (len(missing) < 6)
            for told in goals:
                assert isinstance(told, dict)
                assert set(told) == set(range(1, 7)) - {*missing}
            torque += [it.servo for it in cycle if it.kind == TORQUE]
        there = [servo for servo in range(1, 7) if servo not in missing]
        if there:
            start = there.index(torque[0])
            assert torque == [there[(start + i) % len(there)] for i in range(len(torque))]
        assert number(pilot, "servo_errors", 2) == 0, "who is not there makes none"
        assert number(pilot, "servo_found") == sum(1 << servo - 1 for servo in there)


def test_silence_of_a_servo_counts_after_50_150_and_200_ms(native_bench: Bench) -> None:
    for servo in (1, 6):
        bit = 1 << servo - 1
        pilot = native_bench.pilot().get_ready()
        pilot.simulation.run(1.0)
        assert number(pilot, "servo_checked") == number(pilot, "servo_torque") == 0b111111
        bus = Listener(pilot)
        pilot.simulation.run(0.2)
        bus.change = lambda kind, who, answer, servo=servo: (
            None if who == servo and kind == TORQUE else answer
        )
        lost_ms = run_until(pilot, "servo_torque", 0b111111 - bit)
        assert lost_ms - last_ms(bus, TORQUE, servo) == 151
        assert number(pilot, "servo_alive") == 0b111111
        bus.change = lambda _kind, _who, answer: answer
        run_until(pilot, "servo_torque", 0b111111)
        bus.change = lambda kind, who, answer, servo=servo: (
            None if who == servo and kind == MOVING else answer
        )
        lost_ms = run_until(pilot, "servo_alive", 0b111111 - bit)
        assert lost_ms - last_ms(bus, MOVING, servo) == 51
        assert number(pilot, "servo_found") == 0b111111
        assert number(pilot, "servo_checked") == 0b111111
        lost_ms = run_until(pilot, "servo_found", 0b111111 - bit)
        assert lost_ms - last_ms(bus, MOVING, servo) == 200
        assert number(pilot, "servo_checked") == 0b111111 - bit


def test_a_servo_that_answers_nothing_but_a_ping_is_looked_for_again(native_bench: Bench) -> None:
    """It may have been another, with the other protocol."""
    pilot = native_bench.pilot()
    bus = Listener(pilot)
    bus.change = lambda kind, servo, answer: answer if kind == PING or servo != 3 else None
    for _ in range(2):
        run_until(pilot, "servo_found", 4, mask=4)
        lost_ms = run_until(pilot, "servo_found", 0, mask=4)
        assert lost_ms - last_ms(bus, PING, 3) == 200
    bus.servos[3] = Mx64(3, 1)
    bus.change = lambda _kind, _servo, answer: answer
    run_until(pilot, "servo_alive", 4, mask=4)
    assert number(pilot, "servo_protocol") & 4 == 0


def test_a_servo_that_came_back_is_checked_anew_from_its_first_setting(native_bench: Bench) -> None:
    for before, after in ((1, 2), (2, 1), (2, 2)):
        pilot = native_bench.pilot(before).get_ready()
        pilot.simulation.run(1.5)
        assert number(pilot, "servo_checked") == 0b111111
        bus = Listener(pilot)
        listed = reads(before)
        run_until_read(pilot, bus, 3, listed[-2])
        bus.servos[3].dead = True
        run_until(pilot, "servo_found", 0, mask=4)
        bus.servos[3] = Mx64(3, after)
        bus.heard.clear()
        run_until(pilot, "servo_checked", 4, mask=4)
        assert number(pilot, "servo_checked") == 0b111111
        read = [it.value for it in bus.kinds(SETTING) if it.servo == 3]
        assert read == [(0, 2), *reads(after)]
        assert number(pilot, "servo_protocol") >> 2 & 1 == after - 1
        tells = [(it.servo, it.value) for it in bus.kinds(TELL)]
        assert tells == [(3, 1)]


def test_a_wrong_setting_is_named_until_it_is_right(native_bench: Bench) -> None:
    for version, at, size, value in (
        (2, 20, 4, 0x81020304),
        (2, 10, 1, 0xFF),
        (1, 20, 2, 0x8102),
        (1, 70, 1, 0x80),
    ):
        pilot = native_bench.pilot(version).get_ready()
        pilot.simulation.run(1.5)
        assert number(pilot, "servo_checked") == 0b111111
        assert number(pilot, "wrong_servo") == 0
        bus = Listener(pilot)
        servo = pilot.simulation.servos[3]
        servo.set_register(at, size, value)
        run_until(pilot, "wrong_servo", 4)
        assert number(pilot, "servo_checked") == 0b110111
        assert number(pilot, "wrong_register") == at
        assert number(pilot, "wrong_value", 4) == value
        bus.heard.clear()
        pilot.simulation.servos[1].dead = True
        for _ in range(800):
            pilot.simulation.run(0.001)
            assert number(pilot, "wrong_servo") == 4
            assert not number(pilot, "servo_checked") & 8
        assert {it.servo for it in bus.kinds(SETTING)[2:]} == {4}
        count = len(reads(version))
        (read,) = ((start, size) for start, size in reads(version) if start <= at < start + size)
        run_until_read(pilot, bus, 4, read)
        servo.set_register(at, size, {s.address: s.least for s in MODEL[version].settings}[at])
        bus.heard.clear()
        run_until(pilot, "servo_checked", 8, mask=8)
        assert len([it for it in bus.kinds(SETTING) if it.servo == 4]) == count
        assert number(pilot, "wrong_servo") == 0
        servo.set_register(at, size, value)
        run_until(pilot, "wrong_servo", 4)
        servo.dead = True
        run_until(pilot, "servo_found", 0b110101)
        assert number(pilot, "wrong_servo") == 0


def test_servos_are_told_until_they_say_yes(native_bench: Bench) -> None:
    for version in (1, 2, MIXED):
        pilot = native_bench.pilot(version)
        bus = Listener(pilot)
        for servo in bus.servos.values():
            servo.write(servo.registers.torque, b"\1")
        pilot.simulation.run(2.0)
        assert {it.value for it in bus.kinds(TELL)} == {0}
        assert sorted(it.servo for it in bus.kinds(TELL)) == [1, 2, 3, 4, 5, 6]
        pilot.simulation.servos[4].write(24 if versions_of(version)[4] == 1 else 64, b"\1")
        bus.heard.clear()
        pilot.simulation.run(0.3)
        assert [(it.servo, it.value) for it in bus.kinds(TELL)] == [(5, 0)]
        bus.heard.clear()
        deaf = bus.servos[2]
        for servo in bus.servos.values():
            servo.goal_enables_torque = False
        lost = iter((True, True))

        def lose(
            kind: str, servo: int, answer: bytes, deaf: Mx64 = deaf, lost: Iterator[bool] = lost
        ) -> bytes | None:
            if (kind, servo) == (TELL, 2) and next(lost, False):
                deaf.switch_off()
                return None
            return answer

        bus.change = lose
        assert pilot.set_up() == 0
        pilot.simulation.run(0.5)
        told = [(it.servo, it.value) for it in bus.kinds(TELL)]
        assert told == [(i, 1) for i in (1, 2, 2, 2, 3, 4, 5, 6)]
        more = [cycle[-1].kind for cycle in cycles(bus.heard)[2:16]]
        assert set(more[::2]) | set(more[1::2]) == {TELL, TORQUE}
        assert {TELL} in (set(more[::2]), set(more[1::2]))


def test_a_servo_that_holds_without_saying_yes_is_told_until_that_is_read(
    native_bench: Bench,
) -> None:
    """With another status return level it answers no write: its settings are read all the same."""
    for version, register in ((1, 16), (2, 68)):
        pilot = native_bench.pilot(version)
        pilot.simulation.servos[1].set_register(register, 1, 1)
        bus = Listener(pilot)
        pilot.get_ready()
        told = [it.value for it in bus.kinds(TELL) if it.servo == 2]
        assert told.count(1) <= 14, "two rounds of questions for torque"
        assert number(pilot, "servo_checked") == 0b111101
        assert (number(pilot, "wrong_servo"), number(pilot, "wrong_register")) == (2, register)


def test_a_fault_is_said_as_long_as_it_lasts(native_bench: Bench) -> None:
    for version in (1, 2):
        pilot = native_bench.pilot(version).get_ready()
        servos = pilot.simulation.servos
        for faults in ((0,), (3, 5), (0, 1, 2, 3, 4, 5), (5,), ()):
            for i, servo in enumerate(servos):
                servo.fault = i in faults
            pilot.simulation.run(0.03)
            assert number(pilot, "servo_fault") == sum(1 << i for i in faults)


def test_a_shutdown_is_seen_with_the_next_position(native_bench: Bench) -> None:
    pilot = native_bench.pilot(1).get_ready()
    for servo in pilot.simulation.servos:
        bit = 1 << servo.number - 1
        servo.set_register(34, 2, 0)
        pilot.simulation.run(0.021)
        assert number(pilot, "servo_torque") == 0b111111 - bit
        for _ in range(100):
            pilot.simulation.run(0.001)
            assert number(pilot, "servo_torque") == 0b111111 - bit, "though it says it holds"
        servo.set_register(*servo.registers.limit)
        run_until(pilot, "servo_torque", 0b111111)


def test_answers_that_do_not_fit_are_errors_and_nothing_else(native_bench: Bench) -> None:
    for version in (1, 2):
        protocol = protocol1 if version == 1 else protocol2
        pilot = native_bench.pilot(version).get_ready()
        pilot.simulation.run(1.5)
        wrongs: list[Callable[[bytes], bytes | None]] = [
            lambda _answer, protocol=protocol: protocol.status(3, b"\1\2\3\4\5\6\7"),
            lambda answer: answer[:-1] + bytes([answer[-1] ^ 1]),
            lambda _answer: None,
        ]
        if version == 2:
            wrongs.append(lambda answer: protocol2.status(4, answer[9:-2]))
        for wrong in wrongs:
            bus = Listener(pilot)
            before = number(pilot, "servo_errors", 2)
            bus.change = lambda kind, servo, answer, wrong=wrong: (
                wrong(answer) if servo == 3 and kind not in (PING, TELL) else answer
            )
            pilot.simulation.run(0.15)
            assert number(pilot, "servo_alive") == 0b111011
            bus.change = lambda _kind, _servo, answer: answer
            asked = [it for it in bus.heard if it.servo == 3 and it.kind not in (PING, TELL)]
            pilot.simulation.run(0.005)
            assert number(pilot, "servo_errors", 2) - before == len(asked)
            missed = [number(pilot, "servo_missed", 1, i) for i in range(6)]
            assert missed == [0, 0, number(pilot, "servo_errors", 2) % 256, 0, 0, 0]
            run_until(pilot, "servo_alive", 0b111111)


def test_a_request_is_over_after_1280_us_without_an_answer(native_bench: Bench) -> None:
    pilot = native_bench.pilot()
    pilot.simulation.run(0.5)
    bus = Listener(pilot)
    pilot.simulation.servos[3].dead = True
    for _ in range(10):
        pilot.simulation.board.send(b"\0" * 1000)  # Each byte wakes the board.
        pilot.simulation.run(0.01)
    heard = bus.heard[:-1]
    waited = [
        other.begin_s - one.end_s
        for one, other in pairwise(heard)
        if one.kind == MOVING and not one.answered
    ]
    assert len(waited) >= 9
    assert waited == pytest.approx([0.001285] * len(waited), abs=6e-6)


def test_cycles_that_take_longer_are_counted_and_followed_at_once(native_bench: Bench) -> None:
    for delay_us in (500, 900):
        pilot = native_bench.pilot().get_ready()
        for servo in pilot.simulation.servos:
            servo.return_delay_us = delay_us
        before = number(pilot, "overruns", 2)
        start_s = pilot.simulation.board.now_s
        bus = Listener(pilot)
        pilot.simulation.run(1.0)
        ends_s = [round(CYCLE_S * i, 3) for i in range(1000) if 0 < CYCLE_S * i - start_s <= 1.0]
        late = [s for s in ends_s if any(it.begin_s < s < it.end_s for it in bus.heard)]
        assert number(pilot, "overruns", 2) - before == len(late)
        assert bool(late) == (delay_us == 900)
        for one, other in pairwise(bus.heard):
            if other.kind == GOALS:
                due_s = CYCLE_S * int(other.begin_s / CYCLE_S)
                waits_s = 0.0 if one.end_s > due_s else 0.00102
                assert other.begin_s - max(one.end_s, due_s) < waits_s + 2e-6


def drive_moving(
    pilot: FirmwareHost, bus: Listener, delay_us: int
) -> tuple[list[list[Request]], set[int]]:
    """Drive with servos that answer after such a delay, and that say that they move.

    The servos are 100 steps from neutral and move at 156,328 steps/s towards 340. Returns whole
    cycles and all positions that the table had.
    """
    # Bytes of the PC have the board look at the bus when a cycle is due.
    pilot.simulation.run(CYCLE_S - pilot.simulation.board.now_s % CYCLE_S)
    for servo in pilot.simulation.servos:
        servo.return_delay_us = delay_us
    moving = (10000).to_bytes(4, "little") + (2148).to_bytes(4, "little")
    bus.change = lambda kind, servo, answer: (
        protocol2.status(servo, moving) if kind == MOVING else answer
    )
    seen: set[int] = set()
    before = number(pilot, "servo_errors", 2), number(pilot, "overruns", 2)
    for cycle in range(160):
        if cycle == 5:
            bus.heard.clear()
            seen.clear()
        pilot.simulation.board.send(pilot.command(1, CRUISE, (340,) * 6))
        for _ in range(10):
            pilot.simulation.run(0.001)
            seen |= {number(pilot, "position", 2, i) for i in range(6)}
    assert (number(pilot, "servo_errors", 2), number(pilot, "overruns", 2)) == before
    return cycles(bus.heard), seen


def test_with_late_servos_the_request_takes_the_place_of_a_position(native_bench: Bench) -> None:
    """For 50 cycles, when it would begin after 8 ms."""
    pilot = native_bench.pilot().get_driving()
    bus = Listener(pilot)
    found, seen = drive_moving(pilot, bus, 920)
    for cycle in found:
        check_cycle(cycle, (2,) * 6, goals=True)
    assert seen == {100}
    found, seen = drive_moving(pilot, bus, 940)
    # Motion at its velocity for 10 ms; twice if its torque and state are read in succession.
    assert seen == {100, 100 + 1563, 100 + 2 * 1563}
    without = [i for i, cycle in enumerate(found) if {it.kind for it in cycle} == {GOALS, MOVING}]
    assert {other - one for one, other in pairwise(without)} == {50}
    for i, cycle in enumerate(found):
        assert [it.servo for it in cycle] == [0, 1, 2, 3, 4, 5, 6]
        assert len([it for it in cycle if it.kind in (STATE, TORQUE)]) == (i not in without)
    torque = [it.servo for cycle in found for it in cycle if it.kind == TORQUE]
    assert successors(torque) == {1}
    found, seen = drive_moving(pilot, bus, 100)
    for cycle in found[52:]:
        check_cycle(cycle, (2,) * 6, goals=True)


def check_renumbering(pilot: FirmwareHost) -> None:
    """Write other ids, which no servo has: at once nothing is known of any, and stays so."""
    errors = number(pilot, "servo_errors", 2)
    others = Setup(servo_id=(101, 102, 103, 104, 105, 106))
    pilot.simulation.board.send(write(Setup.ADDRESS, others.pack()))
    run_until(pilot, "servo_id", 101)
    for _ in range(40):
        for item in ("found", "alive", "torque", "checked", "fault"):
            assert number(pilot, f"servo_{item}") == 0, item
        assert number(pilot, "wrong_servo") == 0
        pilot.simulation.run(0.0003)
    assert number(pilot, "servo_errors", 2) == errors


def test_nothing_is_known_of_servos_with_new_ids(native_bench: Bench) -> None:
    pilot = native_bench.pilot().get_ready()
    pilot.simulation.run(1.5)
    pilot.simulation.servos[2].fault = True
    pilot.simulation.servos[2].set_register(10, 1, 1)
    run_until(pilot, "wrong_servo", 3)
    run_until(pilot, "servo_fault", 4)
    assert number(pilot, "servo_checked") == 0b111011
    check_renumbering(pilot)


def test_what_old_ids_still_answer_is_not_taken(native_bench: Bench) -> None:
    """The setup with the new ids may arrive at any time in a cycle."""
    for version in (1, 2):
        pilot = native_bench.pilot(version).get_ready()
        for moment in range(16):
            run_until(pilot, "servo_torque", 0b111111)
            pilot.simulation.run((0.01 + 0.0006 * moment) - pilot.simulation.board.now_s % 0.01)
            check_renumbering(pilot)
            assert pilot.set_up() == 0
