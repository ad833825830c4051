"""Rules of the firmware that belong to the robot, with the source of the commands as a parameter.

What makes the robot unsafe is refused to the PC and to the radio control alike, and stops both.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import StrEnum

from firmware.simulator.mx64 import Mx64
from tests.support.firmware_host import CRUISE, HOLD_S, ZERO, Bench, FirmwareHost
from tsd_twin.hardware.dynamixel.control_table import (
    BoardIdentity,
    BoardMode,
    Refusal,
    Setup,
    Telemetry,
    Trip,
)

STOP = 2
"""In `arm`."""
BATTERY = Setup(battery_arm_mv=11000, battery_stop_mv=10000)
LEANING = (0, 60, 0, -60, 0, 0)
HEATED_S = 0.6
"""Time in which the board reads the temperature of every servo."""
SLOW_STEP_PER_S = 340.0
"""Speed of an undriven joint: 29 degrees per second."""


class Source(StrEnum):
    """Who drives."""

    PC = "PC"
    RADIO = "radio control"


Act = Callable[[FirmwareHost], object]


def ask(pilot: FirmwareHost, source: Source) -> Telemetry:
    """Request the robot for a source; return the telemetry after it."""
    if source is Source.PC:
        pilot.cycle(0)
        pilot.cycle(1)
        return pilot.telemetry()
    for manual in (False, True):
        pilot.simulation.set_switches(manual=manual)
        pilot.simulation.run(0.1)
    return pilot.telemetry()


def has_robot(seen: Telemetry, source: Source) -> bool:
    return seen.mode == (BoardMode.ARMED if source is Source.PC else BoardMode.RC)


def drive(
    pilot: FirmwareHost, source: Source, seconds: float, throttle: Sequence[int] = CRUISE
) -> Telemetry:
    """Drive with gimbals that are sent upright, at cruising speed by radio."""
    if source is Source.PC:
        return pilot.drive(seconds, throttle=throttle)
    pilot.simulation.set_sticks(0.0, 0.0, 0.0, 1.0)
    pilot.simulation.run(seconds)
    return pilot.telemetry()


def leave(pilot: FirmwareHost, source: Source) -> None:
    """Let a source give the robot back."""
    if source is Source.PC:
        pilot.cycle(0)
    else:
        pilot.simulation.set_sticks(0.0, 0.0, 0.0, 0.0)
        pilot.simulation.set_switches()
        pilot.simulation.run(0.06)


def driven_by(source: Source, bench: Bench, setup: Setup | None = None) -> FirmwareHost:
    """Be driven by a source, with spinning wheels."""
    pilot = bench.pilot(receiver=True).get_ready(setup)
    assert has_robot(ask(pilot, source), source)
    assert has_robot(drive(pilot, source, 0.5), source)
    assert min(pilot.simulation.pulses_us()) > 1200.0
    return pilot


def lean(pilot: FirmwareHost, goal: Sequence[int]) -> None:
    """Let gimbals lean without torque at a robot at rest, as after they were turned by hand."""
    assert pilot.arm().mode == BoardMode.ARMED
    pilot.drive(0.3, throttle=ZERO, goal=goal)
    for _ in range(50):
        pilot.cycle(0, torque=0)
    pilot.simulation.run(HOLD_S)
    assert abs(pilot.telemetry().position[1] - goal[1]) <= 1


def _stuck(pilot: FirmwareHost) -> None:
    lean(pilot, (0, BoardIdentity().neutral_band + 1, 0, 0, 0, 0))
    pilot.simulation.servos[1].jammed = True
    for _ in range(50):
        pilot.cycle(0)


def _set(name: str, value: object, servo: int = 3) -> Act:
    def act(pilot: FirmwareHost) -> None:
        setattr(pilot.simulation.servos[servo], name, value)
        pilot.simulation.run(0.1)

    return act


def _battery(volts: float) -> Act:
    def act(pilot: FirmwareHost) -> None:
        pilot.simulation.set_battery(volts)
        pilot.simulation.run(0.1)

    return act


def _open(pilot: FirmwareHost) -> None:
    pilot.simulation.set_contactor(closed=False)
    pilot.simulation.run(0.1)


def _just_closed(pilot: FirmwareHost) -> None:
    _open(pilot)
    pilot.simulation.set_contactor(closed=True)
    pilot.simulation.run(0.1)


def _welded(pilot: FirmwareHost) -> None:
    pilot.simulation.board.reset(power=True)  # The contactor stays closed.
    pilot.simulation.run(HOLD_S)
    pilot.telemetry()


def _implausible(pilot: FirmwareHost) -> None:
    assert pilot.set_up(Setup(neutral=(2048, 248, 2048, 2048, 2048, 2048))) == 0
    pilot.simulation.run(0.5)


def _wrong_setting(pilot: FirmwareHost) -> None:
    pilot.simulation.servos[2].set_register(112, 4, 50)
    pilot.simulation.run(3.0)


UNSAFE: tuple[tuple[Act, Refusal], ...] = (
    (_open, Refusal.DRIVE),
    (_welded, Refusal.STOP_NOT_PROVEN),
    (_battery(10.5), Refusal.BATTERY),
    (_set("dead", value=True), Refusal.SERVO),
    (_set("fault", value=True), Refusal.SERVO),
    (_wrong_setting, Refusal.SETTING),
    (_implausible, Refusal.NEUTRAL),
    (_stuck, Refusal.NOT_NEUTRAL),
    (_just_closed, Refusal.ESC_HOLD),
)


def what_is_wrong_with_the_robot_is_refused_to_every_source(bench: Bench) -> None:
    for source in Source:
        for make, refusal in UNSAFE:
            pilot = bench.pilot(receiver=True).get_ready(BATTERY)
            make(pilot)
            seen = ask(pilot, source)
            assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, refusal), source
            drive(pilot, source, 0.1)
            assert max(pilot.simulation.pulses_us()) < 1001.0


HAPPENS: tuple[tuple[Act, Trip], ...] = (
    (lambda pilot: pilot.ask(pilot.command(STOP)), Trip.STOPPED),
    (lambda pilot: pilot.simulation.set_switches(kill=True, manual=True), Trip.KILL),
    (lambda pilot: pilot.simulation.lose_receiver(), Trip.RC_LOST),
    (_open, Trip.DRIVE),
    (lambda pilot: pilot.simulation.set_battery(9.8), Trip.BATTERY),
    (_set("dead", value=True), Trip.SERVO),
    (_set("fault", value=True), Trip.SERVO),
    (lambda pilot: Mx64.switch_off(pilot.simulation.servos[3]), Trip.TORQUE),
)


def what_happens_to_the_robot_stops_every_source(bench: Bench) -> None:
    for source in Source:
        for act, trip in HAPPENS:
            pilot = driven_by(source, bench, BATTERY)
            act(pilot)
            if source is Source.PC:
                pilot.drive(1.2)
            pilot.simulation.run(1.2)
            seen = pilot.telemetry()
            assert (seen.mode, seen.trip, seen.trips) == (BoardMode.DISARMED, trip, 1), source
            assert max(pilot.simulation.pulses_us()) < 1001.0


def jam(pilot: FirmwareHost, source: Source, steps: int) -> None:
    """Let one gimbal stop so far from neutral, while the others and the sticks go back."""
    simulation = pilot.simulation
    servo = simulation.servos[1]
    if source is Source.PC:
        pilot.drive(0.5, goal=(0, -steps, 0, 0, 0, 0))
    else:
        simulation.set_sticks(0.0, 1.0, 0.0, 1.0)
        start_s = simulation.board.now_s
        while abs(servo.position - 2048) < steps:
            simulation.run(0.0005)
            assert simulation.board.now_s < start_s + 1.0
    servo.jammed = True
    assert abs(abs(servo.position - 2048) - steps) <= 1


def a_gimbal_that_does_not_follow_stops_every_source(bench: Bench) -> None:
    for source in Source:
        for steps, most_s in ((45, 0.6), (25, 1.4)):
            pilot = driven_by(source, bench)
            jam(pilot, source, steps)
            seen = drive(pilot, source, most_s)
            assert (seen.mode, seen.trip) == (BoardMode.DISARMED, Trip.FOLLOWING), (source, steps)
            assert seen.servo_stuck == 0b000010
            assert max(pilot.simulation.pulses_us()) < 1001.0
        pilot = driven_by(source, bench)
        jam(pilot, source, BoardIdentity().neutral_band - 1)
        assert has_robot(drive(pilot, source, 1.5), source), "within the band"


def a_gimbal_that_is_under_way_follows(bench: Bench) -> None:
    pilot = driven_by(Source.PC, bench)
    for i in range(20):  # Full deflection in both directions.
        far = 340 if i % 2 else -340
        assert pilot.drive(0.3, goal=(far,) * 6).mode == BoardMode.ARMED
    for i in range(150):
        goal = (340 - abs(i * 9 % 1360 - 680),) * 6
        assert pilot.drive(0.01, goal=goal).mode == BoardMode.ARMED


def the_radio_control_has_all_gimbals_or_nothing(bench: Bench) -> None:
    for expected in (0, 0b011111):
        pilot = bench.pilot(receiver=True).get_ready(Setup(servos_expected=expected))
        seen = ask(pilot, Source.RADIO)
        assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, Refusal.RC_WITHOUT_SERVOS)
        pilot.simulation.set_switches()
        pilot.simulation.run(0.1)
        assert has_robot(ask(pilot, Source.PC), Source.PC), "it has the servos of its own"


def a_take_over_waits_until_gimbals_are_upright(bench: Bench) -> None:
    for jammed in (False, True):
        pilot = bench.pilot(receiver=True).get_driving(LEANING)
        pilot.simulation.servos[1].jammed = jammed
        pilot.simulation.set_switches(manual=True)
        seen = pilot.drive(1.0, goal=LEANING)
        assert seen.mode == (BoardMode.DISARMED if jammed else BoardMode.RC)
        assert seen.refusal == (Refusal.NOT_NEUTRAL if jammed else Refusal.NONE)
        pilot.simulation.servos[1].jammed = False
        pilot.simulation.run(0.5)
        assert has_robot(pilot.telemetry(), Source.RADIO) != jammed, "it has to be asked again"


def a_stop_of_the_pc_holds_for_every_source(bench: Bench) -> None:
    for source in Source:
        pilot = driven_by(source, bench)
        pilot.session = (0, 0)  # STOP may come from anybody.
        pilot.ask(pilot.command(STOP))
        assert pilot.telemetry().trip == Trip.STOPPED
        assert max(pilot.simulation.pulses_us()) < 1001.0 or pilot.until_quiet(0.05) < 0.05
        pilot.simulation.set_switches()
        pilot.simulation.run(HOLD_S)
        seen = ask(pilot, Source.RADIO)
        assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, Refusal.STOPPED)
        leave(pilot, Source.RADIO)
        pilot.cycle(1)
        assert pilot.mode() == BoardMode.DISARMED, "1 after 2 is no edge"
        pilot.session = (0, 0)
        pilot.ask(pilot.command(0))  # From another session.
        assert ask(pilot, Source.RADIO).refusal == Refusal.STOPPED
        leave(pilot, Source.RADIO)
        pilot.cycle(0)
        assert has_robot(ask(pilot, source), source), "it is released"


def who_leaves_begins_the_hold_and_a_new_session(bench: Bench) -> None:
    for source in Source:
        pilot = driven_by(source, bench)
        before = pilot.telemetry().nonce
        leave(pilot, source)
        seen = pilot.telemetry()
        assert (seen.mode, seen.esc_ready) == (BoardMode.DISARMED, 0), source
        assert seen.nonce != before
        for other in Source:
            seen = ask(pilot, other)
            assert (seen.mode, seen.refusal) == (BoardMode.DISARMED, Refusal.ESC_HOLD), source
            leave(pilot, other)
        assert pilot.set_up() == 7, "the wheels run down"
        pilot.simulation.run(1.4)
        assert pilot.set_up() == 7, "the wheels run down"
        pilot.simulation.run(0.7)
        assert pilot.set_up() == 0
        assert has_robot(ask(pilot, source), source)


def the_throttles_of_every_source_have_a_limit_and_a_rise(bench: Bench) -> None:
    setup = Setup(throttle_limit=(2300, 2200, 4000), throttle_rise=20)
    full = (4000,) * 3
    for source in Source:
        pilot = bench.pilot(receiver=True).get_ready(setup)
        assert has_robot(ask(pilot, source), source)
        before = ZERO
        for _ in range(30):
            seen = drive(pilot, source, 0.01, full)
            for now, then in zip(seen.throttle_out, before, strict=True):
                assert now - then <= 40, "it takes up to 15 ms"
            before = seen.throttle_out
        seen = drive(pilot, source, 1.2, full)
        third = 4000 if source is Source.PC else CRUISE[2]
        assert seen.throttle_out == (2300, 2200, third), source
        leave(pilot, source)
        assert pilot.telemetry().throttle_out == ZERO


def joints_without_an_operator_approach_slowly(bench: Bench) -> None:
    for version in (1, 2):
        for power in (False, True):
            pilot = bench.pilot(version).get_ready()
            lean(pilot, LEANING)
            simulation = pilot.simulation
            if power:
                simulation.power_cycle()
            else:
                pilot.cycle(0)
            fastest, under_way_s = 0.0, 0.0
            for _ in range(1000):
                simulation.run(0.001)
                rates = [abs(servo.velocity_steps_per_s) for servo in simulation.servos]
                fastest = max(fastest, *rates)
                under_way_s += 0.001 * (5 < abs(simulation.servos[1].goal - 2048) < 55)
            assert fastest < 1.3 * SLOW_STEP_PER_S, version
            # The firmware puts out goals each 10 ms.
            assert abs(under_way_s - 49 / 333) < 0.015, version
            assert max(map(abs, pilot.telemetry().position)) <= 1, version


def joints_get_upright_at_once_while_wheels_run_down(bench: Bench) -> None:
    far = (300, -300, 300, -300, 300, -300)
    for hang in (False, True):
        pilot = bench.pilot().get_driving(far)
        if hang:
            pilot.simulation.board.reset()
        else:
            pilot.cycle(0)
        pilot.simulation.run(0.35)
        assert max(map(abs, pilot.telemetry().position)) <= 1, "29 degrees/s would take 0.9 s"


def a_neutral_far_from_where_a_servo_stands_turns_nothing(bench: Bench) -> None:
    neutral = [2048] * 6
    neutral[1] = 248
    pilot = bench.pilot()
    pilot.simulation.run(HOLD_S)
    assert pilot.set_up(Setup(neutral=tuple(neutral))) == 0
    pilot.simulation.run(1.0)
    servo = pilot.simulation.servos[1]
    assert (servo.position, servo.torque) == (2048, False)
    assert (pilot.telemetry().servo_far, pilot.arm().refusal) == (0b000010, Refusal.NEUTRAL)
    pilot.set_up()
    pilot.simulation.run(1.0)
    assert pilot.telemetry().servo_far == 0
    assert pilot.arm().mode == BoardMode.ARMED
    pilot.drive(0.1, arm=0, throttle=ZERO)
    pilot.simulation.run(HOLD_S)
    for off, far in ((100, 0), (101, 0b111111)):
        pilot.set_up(Setup(neutral=(2048 - off,) * 6))
        pilot.simulation.run(0.05)
        assert pilot.telemetry().servo_far == far
        pilot.set_up()
        pilot.simulation.run(1.0)


def a_stick_rests_between_its_ends(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True).get_ready()
    for stick in range(3):
        for us in (1099, 1901):
            centre = [1500] * 4
            centre[stick] = us
            assert pilot.set_up(Setup(stick_centre=tuple(centre))) == 4, (stick, us)
    for stick in range(4):
        high = [1900] * 4
        high[stick] = 1100
        assert pilot.set_up(Setup(stick_high=tuple(high), stick_centre=(1100,) * 4)) == 4, stick
    assert pilot.set_up(Setup(stick_centre=(1100, 1900, 1500, 1000))) == 0


def the_stop_circuit_is_seen_open_before_the_first_arming(bench: Bench) -> None:
    pilot = bench.pilot().get_ready()
    pilot.simulation.board.reset()
    pilot.simulation.run(HOLD_S)
    assert pilot.arm().mode == BoardMode.ARMED, "a reset does not forget it"
    pilot.drive(0.1, arm=0, throttle=ZERO)
    pilot.simulation.board.reset(power=True)
    pilot.simulation.run(HOLD_S)
    seen = pilot.arm()
    assert (seen.refusal, seen.stop_proven) == (Refusal.STOP_NOT_PROVEN, 0)
    pilot.simulation.power.battery_v = 0.0  # Neither wire measures anything.
    pilot.simulation.board.set_adc(0, 0.0)
    pilot.simulation.set_contactor(closed=False)
    pilot.simulation.power.drive_v = 0.0
    pilot.simulation.board.run(0.1)
    assert pilot.telemetry().stop_proven == 0, "a drive without battery is no news"
    pilot.simulation.power.battery_v = 12.0
    pilot.simulation.run(0.1)
    pilot.simulation.set_contactor(closed=True)
    pilot.simulation.run(HOLD_S)
    seen = pilot.arm()
    assert (seen.mode, seen.stop_proven) == (BoardMode.ARMED, 1)


def _tilt_by_radio(pilot: FirmwareHost, hot: int, celsius: int, *, anew: bool = False) -> int:
    """Largest goal with the stick full ahead and a servo of this temperature."""
    simulation = pilot.simulation
    simulation.servos[hot].temperature_c = celsius
    simulation.run(HEATED_S)
    if anew:
        simulation.set_sticks(0.0, 0.0, 0.0, 0.0)
        simulation.set_switches(manual=False)
        simulation.run(HOLD_S)
        simulation.set_switches(manual=True)
        simulation.run(0.1)
    simulation.set_sticks(1.0, 0.0, 0.0, 1.0)
    simulation.run(1.0)
    assert pilot.mode() == BoardMode.RC
    return max(abs(servo.goal - 2048) for servo in simulation.servos)


def a_hot_servo_slows_the_radio_control(bench: Bench) -> None:
    for hot in (0, 5):
        pilot = bench.pilot(receiver=True).get_ready()
        full = _tilt_by_radio(pilot, hot, 69, anew=True)
        slow = _tilt_by_radio(pilot, hot, 70)
        assert abs(slow - full // 2) <= 2
        assert _tilt_by_radio(pilot, hot, 60) == slow, "it gets faster under somebody's hand"
        assert _tilt_by_radio(pilot, hot, 65, anew=True) == slow
        assert _tilt_by_radio(pilot, hot, 64, anew=True) == full


LAWS: dict[str, Callable[[Bench], None]] = {
    law.__name__: law
    for law in (
        what_is_wrong_with_the_robot_is_refused_to_every_source,
        what_happens_to_the_robot_stops_every_source,
        a_gimbal_that_does_not_follow_stops_every_source,
        a_gimbal_that_is_under_way_follows,
        the_radio_control_has_all_gimbals_or_nothing,
        a_take_over_waits_until_gimbals_are_upright,
        a_stop_of_the_pc_holds_for_every_source,
        who_leaves_begins_the_hold_and_a_new_session,
        the_throttles_of_every_source_have_a_limit_and_a_rise,
        joints_without_an_operator_approach_slowly,
        joints_get_upright_at_once_while_wheels_run_down,
        a_neutral_far_from_where_a_servo_stands_turns_nothing,
        a_stick_rests_between_its_ends,
        a_hot_servo_slows_the_radio_control,
        the_stop_circuit_is_seen_open_before_the_first_arming,
    )
}
