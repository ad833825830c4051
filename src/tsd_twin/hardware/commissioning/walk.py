"""Walk through the steps of commissioning at a machine.

Nothing is armed while a question is open, so a closed terminal, a killed program or Ctrl-C leaves
the wheels off: commands end with each motion, and the watchdog of the hardware stops it otherwise.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Protocol

import numpy as np

from tsd_twin.hardware.commissioning import verdicts
from tsd_twin.hardware.commissioning.findings import Finding, FindingCode, found
from tsd_twin.hardware.commissioning.leaving import signals_held
from tsd_twin.hardware.commissioning.sheet import Result, Sheet
from tsd_twin.hardware.commissioning.steps import (
    MOVING,
    CompareBattery,
    Confirm,
    Connect,
    HandTurn,
    Measure,
    Step,
    Swing,
    Tilt,
    Turn,
    Watch,
)
from tsd_twin.hardware.commissioning.verdicts import Reading
from tsd_twin.hardware.robot_io import HasWatchdog, RobotIO
from tsd_twin.hardware.serial_transport import HardwareError
from tsd_twin.kinematics import Joint
from tsd_twin.lie import Array
from tsd_twin.messages.codes import Reason
from tsd_twin.messages.sentences import sentence
from tsd_twin.safety import Heartbeat

Ask = Callable[[str], str]
"""Shows a question and returns the entered line."""
Say = Callable[[str], None]
_ARM_S = 6.0
"""Maximum time until the robot is armed, with 2 s for the speed controllers."""
_OFF_S = 2.5
"""Time disarmed before arming."""
_SWING_S = 1.5
"""Time of a tilt, and of its return."""
_TURN_S = 6.0
_HAND_TURN_S = 5.0
_CYCLE_S = 0.01
_DISARM_S = 0.1
_RAMP = 0.5
"""Fraction of the time of a swing in which the setpoint moves."""
_RECENT_S = 0.2
_FRESH, _FRESH_S = 4, 2.0
"""New measurements before a reading counts, and the maximum time until they arrive."""
_YES = ("y", "yes")
_SKIPPED = (Measure, Confirm, Tilt, HandTurn, Swing, Turn)
"""Steps that are not repeated after an interruption; the others are quick and read live values."""


class Commissioned(RobotIO, HasWatchdog, Protocol):
    """Hardware interface with a command watchdog."""


@dataclass(frozen=True, slots=True)
class Machine:
    """Machine to be checked."""

    joints: Sequence[Joint]
    wheel_rad_per_s: float
    """Speed of the wheels in their step: the lowest that they can turn at."""
    measures_wheels: bool
    """Whether the robot measures the speed of its wheels."""
    connect: Callable[[], Commissioned]


class Walk:
    """One walk through the steps."""

    def __init__(self, machine: Machine, sheet: Sheet, file: Path, ask: Ask, say: Say) -> None:
        self._machine = machine
        self._sheet = sheet
        self._file = file
        self._ask, self._say = ask, say
        self._io: Commissioned | None = None
        self._beats = 0
        self._joints = np.full(len(machine.joints), np.nan)
        self._value: float | None = None
        self._fastest_rpm: dict[int, float] = {}
        """Largest measured speed by number of the wheel, in this step."""
        self._names = [joint.name for joint in machine.joints]
        self._rest = np.zeros(len(machine.joints))

    def run(self, steps: Sequence[Step]) -> Finding | None:
        """Run the steps until one finds an error; return it, or None if all passed.

        The result of each step is saved before the next one. On a continued sheet, measurements and
        confirmations that passed are skipped, and motions that passed too; live readings are not.

        Raises:
            HardwareError: If the sheet cannot be written, or the input has ended.
        """
        done = self._sheet.passed()
        try:
            for number, step in enumerate(steps, 1):
                if step.name in done and isinstance(step, _SKIPPED):
                    continue
                self._say(f"Step {number} of {len(steps)}: {step.name}")
                finding = self._checked(step)
                at = datetime.now(UTC).isoformat(timespec="seconds")
                self._sheet.results.append(Result(step.name, at, finding, self._value))
                self._sheet.save(self._file)
                if finding is not None:
                    return finding
        finally:
            self.close()
        return None

    def close(self) -> None:
        """Stop the robot and close its connection."""
        with signals_held():
            io, self._io = self._io, None
            if io is not None:
                io.close()

    def _checked(self, step: Step) -> Finding | None:
        self._value = None
        if isinstance(step, MOVING) and not self._agrees(self._motion(step)):
            return found(FindingCode.DECLINED)
        return self._run(step)

    def _motion(self, step: Connect | Swing | Turn) -> str:
        if not isinstance(step, Turn):
            return step.text
        rpm = self._machine.wheel_rad_per_s * 30.0 / math.pi
        return f"{step.text}, at {rpm:.0f} rpm for {_TURN_S:.0f} s"

    def _run(self, step: Step) -> Finding | None:
        match step:
            case Measure():
                self._value = self._number(f"{step.text}, in {step.unit}: ")
                return verdicts.measured(self._value, step.least, step.most, step.unit, step.hint)
            case Confirm():
                agrees = self._agrees(step.text)
                return None if agrees else found(FindingCode.NOT_CONFIRMED, hint=step.hint)
            case Connect():
                return self._connect()
            case Watch():
                self._pause(step.text)
                return self._judge(step)
            case CompareBattery():
                self._value = self._number(f"{step.text}: ")
                readings = self._watch(_RECENT_S)
                if not readings:
                    return found(FindingCode.NO_STATUS)
                return verdicts.battery(readings, self._value)
            case Tilt() | HandTurn():
                return self._tilt(step) if isinstance(step, Tilt) else self._hand_turn(step)
            case Swing():
                return self._swing(step)
            case Turn():
                return self._turn(step)

    def _connect(self) -> Finding | None:
        try:
            with signals_held():  # Or an open connection would not be closed.
                self._io = self._machine.connect()
        except HardwareError as error:
            return found(FindingCode.NO_CONNECTION, text=str(error))
        return None

    def _judge(self, step: Watch) -> Finding | None:
        readings = self._watch(step.seconds)
        if not readings or readings[-1].status.get("battery_v") is None:
            return found(FindingCode.NO_STATUS)
        return step.verdict(readings)

    def _tilt(self, step: Tilt) -> Finding | None:
        self._pause("All gimbals free and upright. Press Enter")
        before = self._position()
        self._pause(step.text)
        after = self._position()
        return verdicts.moved(self._names, step.joint, before, after, verdicts.HAND_DEG)

    def _hand_turn(self, step: HandTurn) -> Finding | None:
        self._pause(step.text)
        readings = self._watch(_HAND_TURN_S)
        return verdicts.sensed(step.wheel, readings) if readings else found(FindingCode.NO_STATUS)

    def _swing(self, step: Swing) -> Finding | None:
        goal = self._rest.copy()
        goal[step.joint] = math.radians(verdicts.SWING_DEG)
        try:
            if finding := self._arm():
                return finding
            before = self._position(armed=True)
            finding = self._hold(goal, _SWING_S, since=self._rest)
            after = self._joints.copy()
            finding = finding or self._hold(self._rest, _SWING_S, since=goal)
        finally:
            self._disarm()
        least_deg = verdicts.SWING_DEG / 2.0
        return finding or verdicts.moved(self._names, step.joint, before, after, least_deg)

    def _turn(self, step: Turn) -> Finding | None:
        goal = self._rest.copy()
        goal[step.joint] = self._machine.wheel_rad_per_s
        try:
            self._fastest_rpm = {}
            finding = self._arm() or self._hold(goal, _TURN_S)
            speed_rpm = self._speed_rpm(step)
        finally:
            self._disarm()
        wanted_rpm = self._machine.wheel_rad_per_s * 30.0 / math.pi
        measured = [i for i, rpm in self._fastest_rpm.items() if rpm > wanted_rpm / 2.0]
        swapped = bool(measured) and step.wheel not in measured
        if finding is not None and not swapped:
            return finding
        seen = self._number("Number of the wheel that turned, from 1; 0 if none: ")
        along = self._agrees("Did it turn in the direction of its arrow?")
        if turned := verdicts.turned(step.wheel, round(seen), along=along):
            return turned
        if swapped:
            return verdicts.wrong_sensor(step.wheel, measured)
        if self._machine.measures_wheels and (
            turned := verdicts.speed(step.wheel, speed_rpm, wanted_rpm, measured=True)
        ):
            return turned
        self._value = self._number("Its speed, by a tachometer or by counting, in rpm: ")
        measures = self._machine.measures_wheels
        return verdicts.speed(step.wheel, self._value, wanted_rpm, measured=measures)

    def _speed_rpm(self, step: Turn) -> float:
        """Return the measured speed of a wheel, rpm; NaN if the robot does not measure it."""
        wheels = self._open().hardware().get("wheels")
        if wheels is None:
            return float(self._joints[step.joint]) * 30.0 / math.pi
        rpm = wheels["rpm"][step.wheel - 1]
        return math.nan if rpm is None else float(rpm)

    def _arm(self) -> Finding | None:
        """Arm with all joints at rest."""
        self._cycle_for(_OFF_S)
        end_s = time.monotonic() + _ARM_S
        while (fault := self._fault()) and time.monotonic() < end_s:
            self._cycle(self._rest, armed=False)
        if fault:
            return found(FindingCode.FAULT, text=fault)
        while time.monotonic() < end_s:
            self._cycle(self._rest, armed=True)
            if fault := self._fault():
                return found(FindingCode.FAULT, text=fault)
            if self._open().hardware().get("board", "armed") == "armed":
                return None
        return found(FindingCode.FAULT, text="it does not arm")

    def _disarm(self) -> None:
        self._cycle_for(_DISARM_S)

    def _hold(self, goal: Array, seconds: float, since: Array | None = None) -> Finding | None:
        """Command a setpoint for a time, with a ramp from `since`; end at once at a fault."""
        start_s = time.monotonic()
        while (elapsed_s := time.monotonic() - start_s) < seconds:
            part = min(1.0, elapsed_s / (_RAMP * seconds))
            setpoint = goal if since is None else since + part * (goal - since)
            self._cycle(setpoint, armed=True)
            self._note_speeds()
            if fault := self._fault():
                return found(FindingCode.FAULT, text=fault)
        return None

    def _note_speeds(self) -> None:
        wheels = self._open().hardware().get("wheels", {})
        for i, rpm in enumerate(wheels.get("rpm", ()), 1):
            if rpm is not None:
                self._fastest_rpm[i] = max(self._fastest_rpm.get(i, 0.0), abs(rpm))

    def _watch(self, seconds: float) -> list[Reading]:
        """Return readings over a time; none if no new measurement arrives."""
        if not self._refresh(armed=False):
            return []
        readings: list[Reading] = []
        end_s = time.monotonic() + seconds
        while not readings or time.monotonic() < end_s:
            self._cycle(self._rest, armed=False)
            status = dict(self._open().hardware())
            readings.append(Reading(status, self._joints.copy(), self._fault()))
        return readings if self._refresh(armed=False) else []

    def _position(self, *, armed: bool = False) -> Array:
        """Return joints that were measured after this call; NaN without a measurement."""
        fresh = self._refresh(armed=armed)
        return self._joints.copy() if fresh else np.full(len(self._names), np.nan)

    def _refresh(self, *, armed: bool) -> bool:
        """Cycle at rest until new measurements have arrived, which were not in flight before."""
        end_s, fresh = time.monotonic() + _FRESH_S, 0
        while fresh < _FRESH:
            if time.monotonic() > end_s:
                return False
            fresh += self._cycle(self._rest, armed=armed)
        return True

    def _cycle_for(self, seconds: float) -> None:
        """Command rest for a time, disarmed."""
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            self._cycle(self._rest, armed=False)

    def _cycle(self, setpoint: Array, *, armed: bool) -> bool:
        """Write a setpoint, wait, and read; return whether there was a new measurement."""
        io, now_s = self._open(), time.monotonic()
        self._beats += 1
        io.set_heartbeat(Heartbeat(armed, self._beats))
        io.write(setpoint, now_s)
        time.sleep(_CYCLE_S)
        measured = io.read(time.monotonic())
        if measured is not None:
            self._joints = measured[: len(self._names)]
        return measured is not None

    def _fault(self) -> str:
        fault = self._open().fault(time.monotonic())
        return sentence(fault) if isinstance(fault, Reason) else fault or ""

    def _open(self) -> Commissioned:
        if self._io is None:
            raise HardwareError("the robot is not connected")
        return self._io

    def _pause(self, text: str) -> None:
        self._ask(f"{text}. ")

    def _agrees(self, text: str) -> bool:
        question = text if text.endswith("?") else f"{text}: start?"
        return self._ask(f"{question} [y/n] ").strip().lower() in _YES

    def _number(self, text: str) -> float:
        while True:
            try:
                value = float(self._ask(text).strip().replace(",", "."))
            except ValueError:
                value = math.nan
            if math.isfinite(value):
                return value
            self._say("Enter a number.")
