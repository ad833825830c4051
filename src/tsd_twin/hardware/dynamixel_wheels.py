"""`RobotIO` for omni robots with Dynamixel wheels on the serial line of a U2D2 or OpenRB-150."""

from __future__ import annotations

import math
import time
from typing import Any

from tsd_twin.hardware.joints import JointCommand, ServoCalibration
from tsd_twin.hardware.link_health import SILENT_S
from tsd_twin.hardware.serial_transport import DeviceThread, HardwareError
from tsd_twin.hardware.wheel_bus import WheelBus, WheelReport
from tsd_twin.lie import Array
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.sentences import sentence
from tsd_twin.robots import OmniDescription
from tsd_twin.safety import Heartbeat

_POWER_CUT = (
    "all servos lost their power together with the line: an OpenRB-150 that is reset cuts it; a "
    "U2D2 does not"
)


class DynamixelWheelsIO:
    """`RobotIO` with a command watchdog; an I/O thread exchanges data."""

    def __init__(
        self, robot: OmniDescription, port: str, calibration: ServoCalibration | None = None
    ) -> None:
        """Connect to the servos.

        Raises:
            HardwareError: If a servo is missing, of another kind, wrongly set or too slow.
        """
        calibration = calibration or ServoCalibration()
        self._bus = WheelBus(robot, calibration)
        calibration.check_joints(self._bus.names.names)
        if calibration.receiver is not None or calibration.neutral_step:
            raise HardwareError(
                "a robot with servos as wheels has no [receiver] and no [neutral_step]: remove "
                "them from the calibration"
            )
        self._count = len(self._bus.names.names)
        self._warn_v = robot.battery.warn_v
        self._heartbeat = Heartbeat(False, 0)
        self._read_s = 0.0
        self._thread = DeviceThread(port, self._bus)

    def read(self, now_s: float) -> Array | None:
        """Return newly measured wheel speeds (n,), NaN where unmeasured; None without any."""
        report = self._recent(now_s)
        if report is None or report.newest_s <= self._read_s:
            return None
        self._read_s = report.newest_s
        return self._bus.speeds(report, now_s)

    def write(self, setpoint: Array, now_s: float) -> None:
        """Pass the latest setpoint (n,) to the I/O thread.

        Raises:
            ValueError: If the setpoint has the wrong shape or a value is not finite.
        """
        self._bus.command = JointCommand.checked(setpoint, self._count, self._heartbeat, now_s)
        self._thread.cycle()

    def set_heartbeat(self, heartbeat: Heartbeat) -> None:
        """Set the heartbeat to send with the next setpoint."""
        self._heartbeat = heartbeat

    def fault(self, now_s: float) -> Reason | None:
        """Return the fault of the servos or their line, or None."""
        report = self._bus.report
        silent = self._bus.health.connection_fault(report and report.newest_s, now_s)
        return silent or self._bus.trouble or self._bus.lost

    def battery_v(self, now_s: float) -> float | None:
        """Return the highest voltage that a servo measures, or None if unknown."""
        report = self._recent(now_s)
        return None if report is None else report.supply_v

    def servo_c(self, now_s: float) -> float | None:
        """Return the latest temperature of the hottest servo, or None if unknown."""
        report = self._recent(now_s)
        return None if report is None else report.hottest_c

    def hardware(self) -> dict[str, Any]:
        """Return the hardware section of the status, JSON-serializable."""
        report = self._bus.report
        status: dict[str, Any] = {"kind": "dynamixel_wheels", "connected": report is not None}
        if report is not None:
            now_s = time.monotonic()
            status["battery_v"] = round(report.supply_v, 1)
            status["servos"] = self._status(report, now_s)
            status["cables"] = self._bus.cables.status()
            status["age_ms"] = round(1000.0 * (now_s - report.newest_s), 1)
        status["warnings"] = self._warnings(report)
        return status | {"servo_link": self._bus.health.status()}

    def close(self) -> None:
        """Stop the wheels and close the line."""
        self._thread.close()

    def _recent(self, now_s: float) -> WheelReport | None:
        report = self._bus.report
        return None if report is None or now_s - report.newest_s > SILENT_S else report

    def _warnings(self, report: WheelReport | None) -> list[str]:
        told = [_POWER_CUT] if self._bus.power_cuts else []
        if report is not None and report.supply_v < self._warn_v:
            told.append(sentence(because(Code.BATTERY_LOW, volts=self._warn_v)))
        return told + self._bus.cables.sentences()

    def _status(self, report: WheelReport, now_s: float) -> dict[str, Any]:
        bus, there = self._bus, sorted(report.present)
        models = [bus.models[i].servo.name for i in there]
        status: dict[str, Any] = {"model": models} | report.status(self._count, now_s)
        amperes = [bus.current_a(i, report.present[i]) for i in there]
        loads = [bus.load_percent(i, report.present[i]) for i in there]
        for name, values in (("current_a", amperes), ("load_percent", loads)):
            shown = [None if math.isnan(value) else round(value, 2) for value in values]
            if any(value is not None for value in shown):
                status[name] = shown
        return status
