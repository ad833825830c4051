"""Safety rules of the firmware, each on its own board; mutants have to break one."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest

from firmware.simulator.mx64 import Mx64
from tests.firmware import source_rules, telemetry_rules, trip_rules, wheel_rules
from tests.firmware.source_rules import HEATED_S
from tests.support.firmware_host import (
    CHECK_S,
    CRUISE,
    CYCLE_S,
    HOLD_S,
    MODEL,
    PING,
    ZERO,
    Bench,
    read,
    sbus_frame,
    write,
)
from tsd_twin.hardware.dynamixel.control_table import (
    ADDRESS,
    BoardCommand,
    BoardIdentity,
    BoardMode,
    Refusal,
    ResetCause,
    Setup,
    Trip,
)
from tsd_twin.hardware.dynamixel.servo_models import MODELS

TILTED = (100, -60, 0, 40, -100, 20)
NEUTRAL_GOALS = [2048] * 6
MISSED, PARITY = 0x04, 0x04
OFF_US, ON_US, LATE_US = 1500, 1550, 20
"""A switch is off below the first threshold, on above the second, and as before between them; other
interrupts of the Mega change a pulse by less than the third."""


def zero_throttle_from_the_first_millisecond(bench: Bench) -> None:
    simulation = bench.pilot().simulation
    simulation.run(1.01)
    for pulse in map(simulation.board.pulse, range(3)):
        assert pulse.first_s < 0.001
        assert pulse.count in (50, 51)
        assert 999.5 < pulse.unarmed_us < 1000.5
        assert 999.5 < pulse.us < 1000.5


def silence_stops(bench: Bench) -> None:
    pilot = bench.pilot().get_driving(TILTED)
    pilot.simulation.run(0.4)
    assert pilot.mode() == BoardMode.ARMED, "it has half a second"
    # 0.405 s have passed, and 0.005 s since the last beat before.
    assert 0.405 + pilot.until_quiet(0.2) < 0.55
    pilot.simulation.run(2.5)
    seen = pilot.telemetry()
    assert (seen.mode, seen.trip, seen.trips) == (BoardMode.DISARMED, Trip.HEARTBEAT, 1)
    assert [servo.goal for servo in pilot.simulation.servos] == NEUTRAL_GOALS
    assert max(map(abs, seen.position)) <= 1


def reading_and_old_beats_do_not_keep_it_going(bench: Bench) -> None:
    pilot = bench.pilot().get_driving()
    old = pilot.command(1, CRUISE, fresh=False)
    for _ in range(55):
        pilot.simulation.board.send(old)
        pilot.simulation.run(CYCLE_S)
    seen = pilot.telemetry()
    assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.HEARTBEAT)


def a_heartbeat_without_its_command_is_none(bench: Bench) -> None:
    pilot = bench.pilot().get_driving()
    for beat in range(55):
        error, _ = pilot.ask(write(BoardCommand.ADDRESS, (1000 + beat).to_bytes(2, "little")))
        assert error == 5
        pilot.simulation.run(0.005)
    assert pilot.mode() == BoardMode.DISARMED


def after_a_trip_only_a_new_arming_arms(bench: Bench) -> None:
    pilot = bench.pilot().get_driving()
    pilot.simulation.run(0.6)
    assert pilot.drive(0.5).mode == BoardMode.DISARMED, "1 again and again"
    assert pilot.drive(HOLD_S, throttle=ZERO).mode == BoardMode.DISARMED
    assert max(pilot.simulation.pulses_us()) < 1001.0
    seen = pilot.arm()
    assert (seen.mode, seen.trip) == (BoardMode.ARMED, Trip.NONE)


def after_a_reset_only_a_new_arming_arms(bench: Bench) -> None:
    pilot = bench.pilot().get_driving()
    pilot.simulation.board.reset()
    pilot.simulation.run(2.5)
    assert pilot.drive(0.3, throttle=ZERO).mode == BoardMode.DISARMED
    assert pilot.telemetry().reset_cause == ResetCause.EXTERNAL
    assert pilot.arm().mode == BoardMode.ARMED


def a_hang_ends_in_a_reset_and_standstill(bench: Bench) -> None:
    pilot = bench.pilot().get_driving(TILTED)
    pilot.simulation.board.hang()
    pilot.simulation.run(0.01)
    assert max(pilot.simulation.pulses_us()) > 1200.0, "the pulses go on by themselves"
    assert pilot.simulation.board.resets == 0
    pilot.simulation.run(0.29)
    assert pilot.simulation.board.resets == 1
    assert max(pilot.simulation.pulses_us()) < 1001.0
    seen = pilot.drive(2.5, throttle=ZERO)
    assert pilot.missed == 0
    assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.WATCHDOG)
    assert (seen.reset_cause, seen.resets, seen.trips) == (ResetCause.WATCHDOG, 1, 1)
    assert pilot.arm().mode == BoardMode.ARMED


def a_lost_tick_ends_in_a_reset(bench: Bench) -> None:
    pilot = bench.pilot().get_driving()
    pilot.simulation.board.stop_tick()
    for _ in range(30):
        pilot.cycle(1, CRUISE)
    assert pilot.simulation.board.resets == 1
    assert max(pilot.simulation.pulses_us()) < 1001.0


def the_hold_of_the_speed_controllers_is_kept(bench: Bench) -> None:
    pilot = bench.pilot().get_ready()
    pilot.simulation.board.reset()
    pilot.simulation.run(1.9)
    seen = pilot.arm(at_once=True)
    assert (seen.mode, seen.refusal, seen.esc_ready) == (
        BoardMode.DISARMED,
        Refusal.ESC_HOLD,
        0,
    )
    pilot.simulation.run(0.2)
    assert pilot.drive(0.1, throttle=ZERO).mode == BoardMode.DISARMED
    seen = pilot.arm()
    assert (seen.mode, seen.refusal, seen.esc_ready) == (BoardMode.ARMED, Refusal.NONE, 1)


def a_recorded_session_arms_nothing(bench: Bench) -> None:
    for refused in (False, True):
        pilot = bench.pilot().get_driving()
        pilot.drive(0.2, arm=0, throttle=ZERO)
        if refused:  # It must not be taken later either.
            assert pilot.arm(at_once=True).refusal == Refusal.ESC_HOLD
        for restart in ("", "reset", "power"):
            if restart == "power":
                pilot.simulation.power_cycle()
            elif restart:
                pilot.simulation.board.reset()
            pilot.simulation.run(HOLD_S)
            for command in pilot.sent:
                pilot.simulation.board.send(command)
                pilot.simulation.run(CYCLE_S)
                assert max(pilot.simulation.pulses_us()) < 1001.0
            pilot.simulation.board.receive()
            seen = pilot.telemetry()
            assert (seen.mode, seen.trips, seen.esc_ready) == (BoardMode.DISARMED, 0, 1)
    assert pilot.arm().mode == BoardMode.ARMED


def commands_that_come_again_are_no_beats(bench: Bench) -> None:
    pilot = bench.pilot().get_driving()
    older = [pilot.command(1, CRUISE) for _ in range(60)]
    pilot.cycle(1, CRUISE)
    for command in older:
        assert pilot.ask(command)[0] == 7
        pilot.simulation.run(0.005)
    seen = pilot.telemetry()
    assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.HEARTBEAT)


def a_low_battery_does_not_arm(bench: Bench) -> None:
    pilot = bench.pilot().get_ready(Setup(battery_arm_mv=11000))
    pilot.simulation.set_battery(10.8)
    pilot.simulation.run(0.06)
    assert pilot.arm().refusal == Refusal.BATTERY
    pilot.simulation.set_battery(11.2)
    pilot.simulation.run(0.06)
    assert pilot.arm().mode == BoardMode.ARMED


def an_empty_battery_stops(bench: Bench) -> None:
    pilot = bench.pilot().get_ready(Setup(battery_stop_mv=10000))
    assert pilot.arm().mode == BoardMode.ARMED
    for volts, seconds in ((9.7, 0.9), (10.5, 0.2), (9.7, 0.9)):
        pilot.simulation.set_battery(volts)
        assert pilot.drive(seconds).mode == BoardMode.ARMED, "a motor that starts does that"
    seen = pilot.drive(0.2)
    assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.BATTERY)
    assert max(pilot.simulation.pulses_us()) < 1001.0


def the_supply_is_no_measure_of_the_battery(bench: Bench) -> None:
    pilot = bench.pilot()
    for supply_v in np.array([0.92, 1.08]) * pilot.simulation.board.SUPPLY_V:
        pilot.simulation.board.set_supply(supply_v)
        pilot.simulation.run(0.06)
        seen = pilot.telemetry()
        assert abs(seen.supply_mv - 1000.0 * supply_v) < 50.0
        assert abs(seen.battery_mv - 12000.0) < 150.0


def a_setup_waits_until_the_wheels_have_run_down(bench: Bench) -> None:
    pilot = bench.pilot().get_driving()
    pilot.cycle(0)
    assert pilot.set_up() == 7
    pilot.simulation.run(1.8)
    assert pilot.set_up() == 7
    pilot.simulation.run(0.2)
    assert pilot.set_up() == 0


def after_every_disarming_the_hold_begins_again(bench: Bench) -> None:
    pilot = bench.pilot().get_driving()
    pilot.simulation.run(0.6)
    assert pilot.telemetry().trip == Trip.HEARTBEAT
    seen = pilot.arm(at_once=True)
    assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, Refusal.ESC_HOLD)
    assert pilot.arm().mode == BoardMode.ARMED
    pilot.simulation.board.send(pilot.command(0) + pilot.command(1))
    pilot.simulation.run(CYCLE_S)
    assert pilot.mode() == BoardMode.DISARMED, "not even within a millisecond"


def the_stop_circuit_stops(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True).get_driving(TILTED)
    pilot.simulation.set_contactor(closed=False)
    seen = pilot.drive(0.15, goal=TILTED)
    assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.DRIVE)
    assert max(pilot.simulation.pulses_us()) < 1001.0
    pilot.simulation.run(0.5)
    assert [servo.goal for servo in pilot.simulation.servos] == NEUTRAL_GOALS
    assert pilot.arm().refusal == Refusal.DRIVE
    pilot.simulation.set_switches(manual=True)
    pilot.simulation.run(0.1)
    seen = pilot.telemetry()
    assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, Refusal.DRIVE), "nor by radio control"


def power_at_the_drive_moves_nothing(bench: Bench) -> None:
    pilot = bench.pilot().get_driving()
    pilot.simulation.set_contactor(closed=False)
    pilot.drive(0.5)
    pilot.simulation.set_contactor(closed=True)
    for _ in range(4):
        assert pilot.drive(0.5).mode == BoardMode.DISARMED, "1 again and again"
        assert max(pilot.simulation.pulses_us()) < 1001.0
    pilot.simulation.set_contactor(closed=False)
    pilot.simulation.run(0.5)
    pilot.simulation.set_contactor(closed=True)
    pilot.simulation.run(1.9)
    seen = pilot.arm(at_once=True)
    assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, Refusal.ESC_HOLD)
    assert pilot.arm().mode == BoardMode.ARMED


def a_drive_that_is_not_measured_does_not_arm(bench: Bench) -> None:
    pilot = bench.pilot().get_ready()
    for volts in (0.0, 0.7 * 12.0):
        pilot.simulation.power.stop_circuit = False
        pilot.simulation.power.drive_v = volts
        pilot.simulation.run(0.03)
        assert pilot.arm(at_once=True).refusal == Refusal.DRIVE, volts


def arming_wants_zero_throttle_and_zero_goals(bench: Bench) -> None:
    pilot = bench.pilot().get_ready()
    for throttle, goal, refusal in (
        (CRUISE, (0,) * 6, Refusal.THROTTLE),
        ((2000, 2000, 2001), (0,) * 6, Refusal.THROTTLE),
        (ZERO, (0, 0, 0, 0, 0, 1), Refusal.GOAL),
    ):
        pilot.cycle(0)
        seen = pilot.cycle(1, throttle, goal)
        assert seen is not None
        assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, refusal)
        assert pilot.drive(0.1, throttle=ZERO).mode == BoardMode.DISARMED, "it has to ask again"
    assert pilot.arm().mode == BoardMode.ARMED


def arming_wants_a_fresh_command(bench: Bench) -> None:
    pilot = bench.pilot().get_ready()
    pilot.cycle(0)
    pilot.cycle(1, fresh=False)
    assert pilot.mode() == BoardMode.DISARMED


def arming_wants_neutral_gimbals(bench: Bench) -> None:
    pilot = bench.pilot().get_driving(TILTED)
    pilot.simulation.servos[1].jammed = True
    pilot.drive(0.5, arm=0, throttle=ZERO)
    seen = pilot.arm()
    assert abs(seen.position[1]) > BoardIdentity().neutral_band
    assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, Refusal.NOT_NEUTRAL)
    pilot.simulation.servos[1].jammed = False
    pilot.simulation.run(0.3)
    assert pilot.arm().mode == BoardMode.ARMED


def without_a_setup_nothing_moves(bench: Bench) -> None:
    pilot = bench.pilot()
    pilot.simulation.run(2.1)
    seen = pilot.arm()
    assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, Refusal.SETUP)
    assert not any(servo.torque for servo in pilot.simulation.servos)


def a_setup_is_kept_over_resets(bench: Bench) -> None:
    neutral = (2000, 2010, 2020, 2030, 2040, 2050)
    reverse = [True, False, True, False, False, False]
    pilot = bench.pilot(neutral=neutral, reverse=reverse)
    pilot.get_ready(Setup(neutral=neutral, reverse=0b101))
    for power in (False, True):
        if power:
            pilot.simulation.power_cycle()
        else:
            pilot.simulation.board.reset()
        pilot.simulation.run(0.5)
        assert pilot.telemetry().position == (0,) * 6
        assert [servo.goal for servo in pilot.simulation.servos] == list(neutral)
        assert all(servo.torque for servo in pilot.simulation.servos)
    pilot.simulation.run(2.0)
    assert pilot.arm().mode == BoardMode.ARMED


def a_setup_that_was_spoilt_is_none(bench: Bench) -> None:
    pilot = bench.pilot().get_ready()
    pilot.simulation.board.poke_eeprom(3, 0x55)
    pilot.simulation.power_cycle()
    pilot.simulation.run(2.1)
    assert pilot.arm().refusal == Refusal.SETUP
    assert pilot.telemetry().position == (0,) * 6


def a_servo_that_dies_stops_and_is_named(bench: Bench) -> None:
    pilot = bench.pilot().get_driving()
    pilot.simulation.servos[3].dead = True
    seen = pilot.drive(0.1)
    assert (seen.mode, seen.trip, seen.servo_alive) == (BoardMode.DISARMED, Trip.SERVO, 0b110111)
    assert max(pilot.simulation.pulses_us()) < 1001.0
    seen = pilot.arm()
    assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, Refusal.SERVO)
    pilot.simulation.run(0.3)
    assert pilot.telemetry().servo_found == 0b110111
    pilot.simulation.servos[3].dead = False
    pilot.simulation.run(0.5)
    assert pilot.arm().mode == BoardMode.ARMED, "it is found again"


def a_servo_in_trouble_stops(bench: Bench) -> None:
    for version in (1, 2):
        pilot = bench.pilot(version).get_driving()
        pilot.simulation.servos[0].fault = True
        seen = pilot.drive(0.1)
        assert (seen.mode, seen.trip, seen.servo_fault) == (BoardMode.DISARMED, Trip.SERVO, 1)
        assert pilot.arm().refusal == Refusal.SERVO


def torque_that_is_lost_stops(bench: Bench) -> None:
    for version, lose in (
        (2, Mx64.switch_off),
        (2, Mx64.restart),
        (1, Mx64.switch_off),
        (1, lambda servo: servo.set_register(34, 2, 0)),
    ):
        pilot = bench.pilot(version).get_driving(TILTED)
        servo = pilot.simulation.servos[3]
        servo.goal_enables_torque = False
        lose(servo)
        seen = pilot.drive(0.09, goal=TILTED)
        assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.TORQUE), version
        assert seen.servo_torque == 0b110111
        assert pilot.until_quiet(0.03) < 0.03
        servo.set_register(*servo.registers.limit)
        pilot.simulation.run(0.5)
        assert servo.torque, "it holds neutral again"
        assert servo.position == pytest.approx(2048, abs=1)
        pilot.simulation.run(1.5)
        assert pilot.arm().mode == BoardMode.ARMED


def a_goal_gives_torque_back_with_protocol_1(bench: Bench) -> None:
    pilot = bench.pilot(1).get_driving(TILTED)
    for servo in pilot.simulation.servos:
        servo.switch_off()
        pilot.simulation.run(0.011)
        assert servo.torque


def arming_wants_torque(bench: Bench) -> None:
    pilot = bench.pilot().get_ready()
    pilot.drive(0.5, arm=0, throttle=ZERO)
    for _ in range(30):
        pilot.cycle(0, torque=0)
    seen = pilot.cycle(1)
    assert seen is not None
    assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, Refusal.TORQUE)
    pilot.drive(0.4, arm=0, throttle=ZERO)
    assert pilot.arm().mode == BoardMode.ARMED


def settings_of_servos_are_checked(bench: Bench) -> None:
    for version, half, above in itertools.product((1, 2), (0, 1), (False, True)):
        pilot = bench.pilot(version)
        servos = pilot.simulation.servos
        wrong: list[tuple[int, int, int]] = []
        # Registers of the same read are wrong at different servos.
        for i, s in enumerate(MODEL[version].settings[half::2]):
            value = (s.most + 1 if above else s.least - 1) % (1 << 8 * s.size)
            servos[i % 6].set_register(s.address, s.size, value)
            wrong.append((i % 6 + 1, s.address, value))
        pilot.get_ready()
        named: set[tuple[int, int, int]] = set()
        for _ in range(round(CHECK_S / CYCLE_S)):
            seen = pilot.cycle(0)
            assert seen is not None
            assert not seen.servo_checked
            named.add((seen.wrong_servo, seen.wrong_register, seen.wrong_value))
        assert named == set(wrong)
        seen = pilot.arm()
        assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, Refusal.SETTING)


def one_wrong_setting_is_enough(bench: Bench) -> None:
    for version, which in itertools.product((1, 2), (0, 11, -1)):
        pilot = bench.pilot(version)
        setting, servo = MODEL[version].settings[which], pilot.simulation.servos[which % 6]
        before = setting.value(servo.read(setting.address, setting.size))
        servo.set_register(setting.address, setting.size, setting.most + 1)
        pilot.get_ready()
        seen = pilot.arm()
        assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, Refusal.SETTING)
        assert seen.servo_checked == 0b111111 - (1 << which % 6)
        named = (seen.wrong_servo, seen.wrong_register, seen.wrong_value)
        assert named == (which % 6 + 1, setting.address, setting.most + 1)
        servo.set_register(setting.address, setting.size, before)
        pilot.simulation.run(CHECK_S)
        seen = pilot.arm()
        assert (seen.mode, seen.servo_checked, seen.wrong_servo) == (BoardMode.ARMED, 0b111111, 0)


def a_hot_servo_stops(bench: Bench) -> None:
    for version, hot in ((1, 0), (2, 5)):
        pilot = bench.pilot(version).get_driving()
        servo = pilot.simulation.servos[hot]
        servo.temperature_c = 74
        assert pilot.drive(HEATED_S).mode == BoardMode.ARMED
        servo.temperature_c = 75
        seen = pilot.drive(HEATED_S)
        assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.HOT)
        pilot.drive(0.3, arm=0, throttle=ZERO)
        assert pilot.arm().refusal == Refusal.HOT
        servo.temperature_c = 74
        pilot.simulation.run(HEATED_S)
        assert pilot.arm().mode == BoardMode.ARMED
        pilot.drive(0.1, arm=0, throttle=ZERO)
        pilot.simulation.run(HOLD_S)
        assert pilot.set_up(Setup(servos_expected=63 - (1 << hot))) == 0
        servo.temperature_c = 90
        pilot.simulation.run(HEATED_S)
        assert pilot.arm().mode == BoardMode.ARMED, "a servo that is not expected"


def a_hot_servo_stops_the_radio_control(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True).get_ready()
    pilot.simulation.set_switches(manual=True)
    pilot.simulation.run(0.1)
    assert pilot.mode() == BoardMode.RC
    pilot.simulation.servos[2].temperature_c = 75
    pilot.simulation.run(HEATED_S)
    seen = pilot.telemetry()
    assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.HOT)
    pilot.simulation.run(HOLD_S)
    for manual in (False, True):
        pilot.simulation.set_switches(manual=manual)
        pilot.simulation.run(0.1)
    seen = pilot.telemetry()
    assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, Refusal.HOT)


def servos_are_not_blamed_for_a_disturbed_line(bench: Bench) -> None:
    disturbances = (
        b"\xff\xff\xfd\x00\xc8\x05\x00\x02\0\0\0\0",  # With a wrong sum.
        b"\xff\xff\xfd\x00",  # Given up.
    )
    for disturbance in disturbances:
        for dead, before_s, trip in (
            (True, 0.02, Trip.LINE),
            (False, 0.02, Trip.LINE),
            (True, -1.0, Trip.SERVO),
        ):
            pilot = bench.pilot().get_driving()
            servo = pilot.simulation.servos[1]
            if dead:
                servo.dead = True
            else:
                servo.switch_off()
            ended = 0
            while pilot.simulation.board.now_s and not ended:
                if before_s > 0.0:
                    pilot.simulation.board.send(disturbance)
                    pilot.simulation.run(before_s)
                    pilot.simulation.board.receive()
                seen = pilot.cycle(1, CRUISE)
                ended = seen.trip if seen else 0
            assert ended == trip


def a_disturbance_of_the_line_is_over_after_50_ms(bench: Bench) -> None:
    # A servo counts as silent 50 to 60 ms after it died.
    for dies_s, disturbed_s, trip in ((0.02, 0.0, Trip.SERVO), (0.0, 0.02, Trip.LINE)):
        pilot = bench.pilot().get_driving()
        for event_s in sorted((dies_s, disturbed_s)):
            pilot.simulation.run(event_s)
            if event_s == dies_s:
                pilot.simulation.servos[4].dead = True
            else:
                pilot.simulation.board.send(b"\xff\xff\xfd\x00\xc8\x05\x00\x02\0\0\0\0")
                pilot.simulation.run(0.002)
        assert pilot.drive(0.1).trip == trip


def servos_of_other_models_are_refused(bench: Bench) -> None:
    pilot = bench.pilot()
    pilot.simulation.servos[3].set_register(0, 2, 1060)
    pilot.get_ready()
    seen = pilot.arm()
    assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, Refusal.SETTING)
    assert seen.servo_checked == 0b110111
    assert (seen.wrong_servo, seen.wrong_register, seen.wrong_value) == (4, 0, 1060)
    assert seen.servo_model == (311, 311, 311, 1060, 311, 311)


def each_model_has_its_own_settings(bench: Bench) -> None:
    for model in MODELS.values():
        pilot = bench.pilot(model.protocol)
        for servo in pilot.simulation.servos:
            servo.set_register(0, 2, model.number)
            for s in model.settings:
                if not s.allows(s.value(servo.read(s.address, s.size))):
                    servo.set_register(s.address, s.size, s.least)
        pilot.get_ready()
        pilot.simulation.run(0.3)
        seen = pilot.arm()
        assert (seen.mode, seen.wrong_servo) == (BoardMode.ARMED, 0)
        assert seen.servo_model == (model.number,) * 6


def who_is_disarmed_moves_nothing(bench: Bench) -> None:
    pilot = bench.pilot().get_ready()
    seen = pilot.drive(0.5, arm=0, throttle=CRUISE, goal=TILTED)
    assert seen.throttle_out == ZERO
    assert [servo.goal for servo in pilot.simulation.servos] == NEUTRAL_GOALS
    assert max(map(abs, seen.position)) <= 1


def a_disarming_counts_without_a_beat(bench: Bench) -> None:
    pilot = bench.pilot().get_driving()
    seen = pilot.cycle(0, CRUISE, fresh=False)
    assert seen is not None
    assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.NONE)
    assert pilot.until_quiet(0.03) < 0.03


def a_flood_does_not_keep_the_rules_waiting(bench: Bench) -> None:
    pilot = bench.pilot().get_driving()
    random = np.random.default_rng(9)
    for _ in range(11):
        pilot.simulation.board.send(random.bytes(5000))
        pilot.simulation.run(0.05)
    assert max(pilot.simulation.pulses_us()) < 1001.0
    assert pilot.simulation.board.resets == 0, "the watchdog had to end it"
    pilot.simulation.run(0.2)
    seen = pilot.telemetry()
    assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.HEARTBEAT)


def writes_that_are_wrong_change_nothing(bench: Bench) -> None:
    pilot = bench.pilot().get_driving()
    good = BoardCommand(pilot.beat + 1, 1, 1, CRUISE, (0,) * 6).pack()
    goal_at = ADDRESS["goal"] - BoardCommand.ADDRESS
    for packet, error in (
        (write(ADDRESS["throttle"], b"\xa0\x0f"), 5),
        (write(ADDRESS["arm"], b"\0"), 5),
        (write(BoardCommand.ADDRESS, good[:4] + b"\xa1\x0f" + good[6:]), 4),
        (write(BoardCommand.ADDRESS, good[:4] + b"\xcf\x07" + good[6:]), 4),
        (write(BoardCommand.ADDRESS, good[:2] + b"\x03" + good[3:]), 4),
        (write(BoardCommand.ADDRESS, good[:goal_at] + b"\x00\x04" + good[goal_at + 2 :]), 4),
        (write(BoardCommand.ADDRESS, good + b"\0"), 7),
        (write(Setup.ADDRESS, Setup().pack()), 7),
        (write(Setup.ADDRESS, Setup().pack() + good), 7),
        (write(Setup.ADDRESS, Setup().pack()[:2]), 5),
        (write(Setup.ADDRESS + 1, Setup().pack()[1:]), 5),
        (write(0, b"\0"), 7),
        (write(ADDRESS["mode"], b"\1"), 7),
        (write(ADDRESS["throttle_out"], b"\xa0\x0f"), 7),
        (write(65535, b"\0\0"), 7),
        (write(BoardCommand.ADDRESS, b""), 5),
    ):
        assert pilot.ask(packet) == (error, b""), packet.hex()
        seen = pilot.telemetry()
        assert (seen.mode, seen.throttle_out) == (BoardMode.ARMED, CRUISE)
        assert seen.beat == pilot.beat
        pilot.cycle(1, CRUISE)


def goals_end_at_their_limit(bench: Bench) -> None:
    pilot = bench.pilot().get_ready(Setup(goal_limit=50))
    assert pilot.arm().mode == BoardMode.ARMED
    pilot.drive(0.2, goal=(1023, -1023, 51, -51, 50, -50))
    expected = [2098, 1998, 2098, 1998, 2098, 1998]
    assert [servo.goal for servo in pilot.simulation.servos] == expected


def servos_hold_while_armed(bench: Bench) -> None:
    pilot = bench.pilot().get_driving()
    for _ in range(30):
        pilot.cycle(1, CRUISE, torque=0)
    assert all(servo.torque for servo in pilot.simulation.servos)
    for _ in range(30):
        pilot.cycle(0, torque=0)
    assert not any(servo.torque for servo in pilot.simulation.servos)


def the_kill_switch_stops(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True).get_driving()
    pilot.simulation.set_switches(kill=True)
    seen = pilot.drive(0.1)
    assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.KILL)
    assert max(pilot.simulation.pulses_us()) < 1001.0
    assert pilot.arm().refusal == Refusal.KILL
    pilot.simulation.set_switches()
    assert pilot.drive(0.3, throttle=ZERO).mode == BoardMode.DISARMED
    assert pilot.arm().mode == BoardMode.ARMED


def a_lost_radio_control_stops(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True).get_driving()
    pilot.simulation.lose_receiver()
    seen = pilot.drive(0.2)
    assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.RC_LOST)
    assert max(pilot.simulation.pulses_us()) < 1001.0
    assert pilot.arm().refusal == Refusal.RECEIVER


def a_wire_of_the_receiver_that_is_off_stops(bench: Bench) -> None:
    for channel in range(6):
        pilot = bench.pilot(receiver=True).get_driving()
        pilot.simulation.lose_receiver(channel)
        assert pilot.drive(0.2).trip == Trip.RC_LOST
        assert max(pilot.simulation.pulses_us()) < 1001.0
    pilot = bench.pilot()
    pilot.simulation.lose_receiver(0, 1, 2, 3, 5)
    assert pilot.get_ready().arm().refusal == Refusal.RECEIVER, (
        "the kill switch alone is no receiver"
    )


def a_lost_radio_control_is_missed_after_a_reset_too(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True).get_driving()
    pilot.simulation.lose_receiver()
    pilot.simulation.board.reset()
    pilot.simulation.run(2.1)
    assert pilot.arm().refusal == Refusal.RECEIVER


def an_expected_receiver_is_missed_when_power_comes(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True).get_ready(Setup(receiver_expected=1))
    assert pilot.arm().mode == BoardMode.ARMED
    pilot.simulation.lose_receiver()
    pilot.simulation.power_cycle()
    pilot.simulation.run(HOLD_S)
    assert pilot.arm().refusal == Refusal.RECEIVER
    pilot.simulation.set_switches()
    pilot.simulation.run(0.1)
    assert pilot.arm().mode == BoardMode.ARMED


def the_radio_control_begins_at_the_low_end_of_its_stick(bench: Bench) -> None:
    for low_us, begins in ((1100, False), (1135, True)):
        pilot = bench.pilot(receiver=True)
        pilot.get_ready(Setup(stick_low=(1100, 1100, 1100, low_us)))
        pilot.simulation.set_sticks(0.0, 0.0, 0.0, 0.05)  # 1140 us.
        pilot.simulation.run(0.05)
        pilot.simulation.set_switches(manual=True)
        pilot.simulation.run(0.1)
        assert pilot.mode() == (BoardMode.RC if begins else BoardMode.DISARMED)


def the_channels_of_the_receiver_are_those_of_the_setup(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True)
    # Kill and speed have changed places, as have forward and left.
    pilot.get_ready(Setup(receiver_map=0x534201, receiver_expected=1))
    # An edge waits for a running interrupt, of up to 103 cycles of 16 MHz.
    assert pilot.telemetry().rc[3:5] == pytest.approx((1900, 1100), abs=7)
    assert pilot.arm().refusal == Refusal.KILL, "its channel is short"
    pilot.simulation.set_sticks(0.5, 0.0, 0.0, 1.0)
    pilot.simulation.run(0.1)
    assert pilot.telemetry().rc[:2] == pytest.approx((1500, 1700), abs=2)
    assert pilot.arm().mode == BoardMode.ARMED


def a_receiver_without_signal_stops(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True, sbus=True).get_driving()
    pilot.simulation.set_signal(lost=True)
    seen = pilot.drive(0.03)
    assert (seen.mode, seen.trip, seen.rc) == (BoardMode.DISARMED, Trip.RC_LOST, (0,) * 6)
    assert max(pilot.simulation.pulses_us()) < 1001.0
    assert pilot.arm().refusal == Refusal.RECEIVER
    pilot.simulation.set_signal(lost=False)
    pilot.simulation.run(0.1)
    assert pilot.arm().mode == BoardMode.ARMED


def frames_that_are_not_heard_well_are_none(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True, sbus=True).get_ready()
    board, us = pilot.simulation.board, pilot.simulation.receiver_us
    frame = sbus_frame(us, 0)
    for heard, errors in (
        (sbus_frame(us, MISSED), 0),
        (frame, PARITY),
        (b"\x0e" + frame[1:], 0),
        (frame[:-1] + b"\x01", 0),
        (frame[:-1], 0),
    ):
        board.send_frames()
        pilot.simulation.run(0.1)
        assert pilot.arm().mode == BoardMode.ARMED
        board.send_frames(on=False)
        for _ in range(15):
            board.send_from_receiver(heard, errors)
            pilot.cycle(1, CRUISE)
        seen = pilot.telemetry()
        assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.RC_LOST), heard.hex()
        assert seen.rc == (0,) * 6


def pulses_end_where_the_setup_says(bench: Bench) -> None:
    low, high = (2000, 2200, 2400), (4000, 3000, 4400)
    pilot = bench.pilot()
    pilot.simulation.set_contactor(closed=False)
    pilot.get_ready(Setup(pulse_low=low, pulse_high=high))
    pilot.zero_us = (1000.0, 1100.0, 1200.0)
    pilot.simulation.set_contactor(closed=True)
    pilot.simulation.run(HOLD_S)
    assert pilot.arm().mode == BoardMode.ARMED
    for throttle, pulses_us in (
        (ZERO, (1000, 1100, 1200)),
        ((3000, 3000, 3000), (1500, 1300, 1700)),
        ((4000, 4000, 4000), (2000, 1500, 2200)),
        (ZERO, (1000, 1100, 1200)),
    ):
        pilot.drive(0.1, throttle=throttle)
        assert pilot.simulation.pulses_us() == pytest.approx(pulses_us, abs=0.6)


def zero_throttle_changes_without_power_only(bench: Bench) -> None:
    pilot = bench.pilot().get_ready()
    setup = Setup(pulse_low=(2000, 2000, 2100))
    assert pilot.set_up(setup) == 7
    pilot.simulation.run(0.1)
    assert max(pilot.simulation.pulses_us()) < 1001.0
    pilot.simulation.set_contactor(closed=False)
    pilot.simulation.run(0.3)
    assert pilot.set_up(setup) == 0
    pilot.zero_us = (1000.0, 1000.0, 1050.0)
    pilot.simulation.run(0.1)
    assert pilot.simulation.pulses_us()[2] == pytest.approx(1050.0, abs=0.6)


def the_radio_control_takes_over_and_gives_back(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True).get_driving()
    pilot.simulation.set_switches(manual=True)
    # A frame of the receiver, and gimbals that the PC has tilted become upright: 97 ms at most.
    seen = pilot.drive(0.11, goal=TILTED)
    assert seen.mode == BoardMode.RC
    assert seen.throttle_out == ZERO, "its stick for the speed is at zero"
    assert [servo.goal for servo in pilot.simulation.servos] == NEUTRAL_GOALS
    assert pilot.arm().mode == BoardMode.RC
    pilot.simulation.set_sticks(0.0, 0.0, 0.0, 1.0)
    assert pilot.drive(0.1).throttle_out == CRUISE
    pilot.simulation.set_switches()
    seen = pilot.drive(0.1)
    assert (seen.mode, seen.trips) == (BoardMode.DISARMED, 1)
    assert max(pilot.simulation.pulses_us()) < 1001.0


def a_switch_between_its_ends_does_not_chatter(bench: Bench) -> None:
    """A switch turns only beyond the farther of its two thresholds, whatever pulses come before."""
    pilot, random = bench.pilot(receiver=True).get_driving(), np.random.default_rng(7)
    sim = pilot.simulation

    def switches(kill_us: float, manual_us: float) -> None:
        sim.receiver_us[4:] = [round(kill_us), round(manual_us)]
        sim.board.set_receiver(sim.receiver_us)

    def around(us: float, least: float = 900.0, most: float = 2100.0) -> list[float]:
        """Any pulses between limits, then pulses near one of them."""
        near = np.clip(us + np.cumsum(random.normal(0.0, 4.0, 8)), least, most)
        return [*random.uniform(least, most, 6), *near]

    pairs = zip(around(OFF_US, OFF_US + LATE_US), around(ON_US, most=ON_US - LATE_US), strict=True)
    for kill_us, manual_us in pairs:
        switches(kill_us, manual_us)
        seen = pilot.drive(0.06)
        assert (seen.mode, seen.trips) == (BoardMode.ARMED, 0), "both keep their side"
    switches(1900, ON_US + LATE_US)
    assert pilot.drive(0.11).mode == BoardMode.RC
    for manual_us in around(OFF_US, OFF_US + LATE_US):
        switches(1900, manual_us)
        sim.run(0.06)
        seen = pilot.telemetry()
        assert (seen.mode, seen.trips) == (BoardMode.RC, 1), "taken once"
    switches(1900, OFF_US - LATE_US)
    sim.run(0.06)
    for manual_us in around(OFF_US, most=ON_US - LATE_US):
        switches(1900, manual_us)
        sim.run(0.06)
        assert pilot.mode() == BoardMode.DISARMED, "given back once"
    switches(OFF_US - LATE_US, 1100)
    sim.run(HOLD_S)
    for kill_us in around(OFF_US, most=ON_US - LATE_US):
        switches(kill_us, 1100)
        sim.run(0.06)
        assert pilot.arm(at_once=True).refusal == Refusal.KILL, "killed until it is clearly at run"
    switches(ON_US + LATE_US, 1100)
    sim.run(0.06)
    assert pilot.arm().mode == BoardMode.ARMED


def the_radio_control_begins_with_its_switch_and_no_speed(bench: Bench) -> None:
    pilot = bench.pilot().get_ready()
    pilot.simulation.set_switches(manual=True)
    pilot.simulation.run(0.3)
    assert pilot.mode() == BoardMode.DISARMED, "the switch was on before"
    assert pilot.arm().refusal == Refusal.RC
    pilot.simulation.set_switches()
    pilot.simulation.set_sticks(0.0, 0.0, 0.0, 0.5)
    pilot.simulation.run(0.1)
    pilot.simulation.set_switches(manual=True)
    pilot.simulation.run(0.1)
    seen = pilot.telemetry()
    assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, Refusal.THROTTLE)
    pilot.simulation.set_sticks(0.0, 0.0, 0.0, 0.0)
    pilot.simulation.run(0.1)
    assert pilot.mode() == BoardMode.DISARMED, "it has to be asked again"
    pilot.simulation.set_switches()
    pilot.simulation.run(0.1)
    pilot.simulation.set_switches(manual=True)
    pilot.simulation.run(0.1)
    assert pilot.mode() == BoardMode.RC


def the_radio_control_is_stopped_like_the_pc(bench: Bench) -> None:
    for kill, trip in ((True, Trip.KILL), (False, Trip.RC_LOST)):
        pilot = bench.pilot(receiver=True).get_ready()
        pilot.simulation.set_switches(manual=True)
        pilot.simulation.run(0.1)
        pilot.simulation.set_sticks(0.0, 0.0, 0.0, 1.0)
        pilot.simulation.run(0.1)
        assert min(pilot.simulation.pulses_us()) > 1200.0
        if kill:
            pilot.simulation.set_switches(kill=True, manual=True)
        else:
            pilot.simulation.lose_receiver()
        pilot.simulation.run(0.2)
        seen = pilot.telemetry()
        assert (seen.mode, seen.trip) == (BoardMode.DISARMED, trip)
        assert max(pilot.simulation.pulses_us()) < 1001.0


def power_makes_a_new_start(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True).get_driving()
    pilot.simulation.run(0.6)
    pilot.simulation.lose_receiver()
    for cause, lose_memory in ((ResetCause.POWER_ON, False), (ResetCause.BROWN_OUT, True)):
        pilot.simulation.board.off()
        pilot.simulation.set_contactor(closed=False)
        pilot.simulation.run(0.2)
        pilot.simulation.board.on(cause, lose_memory=lose_memory)
        pilot.simulation.run(0.05)
        pilot.simulation.set_contactor(closed=True)
        pilot.simulation.run(HOLD_S)
        seen = pilot.telemetry()
        brown_out, board = ResetCause.BROWN_OUT, pilot.simulation.board
        reported = board.BROWN_OUT if cause == brown_out else cause
        assert (seen.trips, seen.resets, seen.reset_cause) == (0, 0, reported)
        assert pilot.arm().mode == BoardMode.ARMED, "the receiver was forgotten"
        pilot.drive(0.1, arm=0, throttle=ZERO)


def questions_are_answered_at_once(bench: Bench) -> None:
    pilot = bench.pilot()
    for servo in pilot.simulation.servos:
        servo.dead = True  # Answers of servos take their time too, on the chip.
    pilot.simulation.run(0.1)
    early = 0
    for _ in range(20):
        pilot.simulation.board.receive()
        pilot.simulation.board.send(PING)
        pilot.simulation.run(0.00058)
        answer = pilot.simulation.board.receive()
        early += len(answer) == 14
        pilot.simulation.run(0.00004)
        answer += pilot.simulation.board.receive()
        assert len(answer) == 14, "it waits for its next millisecond"
        pilot.simulation.run(0.00133)
    assert early >= 16, "the longest stage of a tick delays few answers"


def servos_have_the_ids_of_the_setup(bench: Bench) -> None:
    random = np.random.default_rng(11)
    for version in (1, 2, (2, 1, 1, 2, 1, 2)):
        ids = tuple(map(int, 1 + random.permutation(252)[:6]))
        pilot = bench.pilot(version, ids=ids).get_ready(Setup(servo_id=ids))
        pilot.simulation.run(1.5)  # They are checked.
        assert pilot.arm().mode == BoardMode.ARMED
        seen = pilot.drive(0.5, goal=TILTED)
        assert seen.mode == BoardMode.ARMED
        servos = pilot.simulation.servos
        assert [servo.goal for servo in servos] == [2048 + steps for steps in TILTED]
        assert seen.position == pytest.approx(TILTED, abs=2)
        lost = int(random.integers(6))
        servos[lost].dead = True
        seen = pilot.drive(0.1, goal=TILTED)
        assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.SERVO)
        assert seen.servo_alive == 0b111111 - (1 << lost)
        servos[lost].dead = False
        pilot.simulation.power_cycle()
        pilot.simulation.run(HOLD_S)
        assert pilot.arm().mode == BoardMode.ARMED, "the ids are kept"


def a_servo_that_is_not_there_is_missed_by_its_id(bench: Bench) -> None:
    pilot = bench.pilot().get_ready(Setup(servo_id=(1, 2, 3, 40, 5, 6)))
    seen = pilot.arm()
    assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, Refusal.SERVO)
    assert seen.servo_found == 0b110111
    pilot.set_up(Setup())
    pilot.simulation.run(2.0)
    assert pilot.arm().mode == BoardMode.ARMED


def ids_of_servos_are_checked(bench: Bench) -> None:
    # The number behind the ids is none: its lower byte is the id of servo 1.
    pilot = bench.pilot().get_ready(Setup(neutral=(2049,) * 6))
    before = pilot.ask(read(Setup.ADDRESS, Setup.LAYOUT.size))
    random = np.random.default_rng(5)
    for _ in range(10):
        ids = (1 + random.permutation(252)[:6]).tolist()
        one, other = random.permutation(6)[:2]
        for wrong in (0, 253, ids[other]):
            put = (*ids[:one], wrong, *ids[one + 1 :])
            assert pilot.set_up(Setup(servo_id=put, goal_limit=7)) == 4, put
    for one in range(6):
        for other in range(one):
            ids = [1, 2, 3, 4, 5, 252]
            ids[one] = ids[other]
            assert pilot.set_up(Setup(servo_id=tuple(ids))) == 4, ids
    assert pilot.ask(read(Setup.ADDRESS, Setup.LAYOUT.size)) == before
    assert pilot.arm().mode == BoardMode.ARMED


def new_ids_make_the_servos_unknown(bench: Bench) -> None:
    for first, then in (((1, 2, 3, 4, 5, 6), (6, 5, 4, 3, 2, 1)), ((6, 2, 3, 4, 5, 1),) * 2):
        pilot = bench.pilot().get_ready(Setup(servo_id=first))
        pilot.simulation.run(CHECK_S)
        assert pilot.telemetry().servo_checked == 0b111111
        pilot.set_up(Setup(servo_id=then))
        seen = pilot.telemetry()
        known = seen.servo_alive | seen.servo_torque | seen.servo_checked
        assert known == (0b111111 if first == then else 0)
        pilot.cycle(0)
        pilot.cycle(1)
        assert pilot.mode() == (BoardMode.ARMED if first == then else BoardMode.DISARMED)
        pilot.cycle(0)
        pilot.simulation.run(HOLD_S)
        assert pilot.arm().mode == BoardMode.ARMED
        goal = (10, 20, 30, 40, 50, 60)
        assert pilot.drive(0.1, goal=goal).mode == BoardMode.ARMED
        goals = [servo.goal - 2048 for servo in pilot.simulation.servos]
        assert goals == [10 * (then.index(servo.number) + 1) for servo in pilot.simulation.servos]


Law = Callable[[Bench], None]
LAWS: dict[str, Law] = (
    {
        name: law
        for name, law in list(globals().items())
        if callable(law) and getattr(law, "__module__", "") == __name__
    }
    | source_rules.LAWS
    | wheel_rules.LAWS
    | trip_rules.LAWS
)
ALL_LAWS = LAWS | telemetry_rules.LAWS
"""With the laws of telemetry, which the Mega does not accept."""
