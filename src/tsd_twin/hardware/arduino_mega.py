"""Robot whose controller board (Arduino Mega) drives motors and servos: joints, status, fault."""

from __future__ import annotations

import time
from typing import Any

from tsd_twin.hardware.board_cycle import BAUD, BoardTelemetry, ControllerBoard
from tsd_twin.hardware.board_faults import BoardFaults, past_trips
from tsd_twin.hardware.board_geometry import compiled_geometry
from tsd_twin.hardware.dynamixel.control_table import BoardMode, Telemetry
from tsd_twin.hardware.joints import JointCommand, JointConverter, ServoCalibration, ThrottleLaw
from tsd_twin.hardware.link_health import SILENT_S
from tsd_twin.hardware.serial_transport import DeviceThread
from tsd_twin.hardware.wheel_sensors import WheelSensors
from tsd_twin.lie import Array
from tsd_twin.messages.codes import Reason
from tsd_twin.robots import SingularityDescription
from tsd_twin.safety import Heartbeat

_COUNTERS = ("crc_errors", "rx_errors", "servo_errors", "overruns", "trips", "resets")
_UNEXPECTED_RECEIVER = (
    "the calibration has no receiver, and one sends pulses: the next time the board has power it "
    "arms without it; run 'tsd-bridge --setup'"
)
MODES: dict[int, str] = {
    BoardMode.DISARMED: "disarmed",
    BoardMode.ARMED: "armed",
    BoardMode.RC: "radio control",
}


class ArduinoMegaIO:
    """`RobotIO` for a robot on one serial line, with a command watchdog.

    All methods return immediately; an I/O thread exchanges data using the latest command.
    """

    def __init__(
        self,
        robot: SingularityDescription,
        port: str,
        throttle: ThrottleLaw,
        calibration: ServoCalibration | None = None,
        *,
        servos: bool = True,
        baud: int = BAUD,
    ) -> None:
        """Connect; without `servos`, the board drives the speed controllers only.

        Raises:
            HardwareError: If the board is missing, another device, does not respond, or has too few
                channels.
        """
        self._joints = JointConverter(robot, throttle)
        calibration = calibration or ServoCalibration()
        calibration.check_joints(self._joints.names)
        self._sensors = WheelSensors(robot, self._joints.wheels)
        # The board also contains the curves of the motors.
        compared = servos or robot.wheel_sensor is not None
        self._board = ControllerBoard(
            self._joints,
            calibration,
            robot.battery,
            self._sensors,
            geometry=compiled_geometry(robot) if compared else None,
            servos=servos,
            baud=baud,
        )
        self._speed_controllers = calibration.speed_controllers
        self._expected = self._joints.servos if servos else 0
        self._faults = BoardFaults(
            self._joints,
            self._expected,
            arm_mv=round(1000.0 * robot.battery.arm_v),
            receiver_expected=self._board.receiver_expected,
        )
        self._heartbeat = Heartbeat(False, 0)
        self._read_s = 0.0
        self._thread = DeviceThread(port, self._board)

    def read(self, now_s: float) -> Array | None:
        """Return newly measured joints (n,), NaN where unmeasured; None without a measurement."""
        report = self._recent(now_s)
        if report is None or report.received_s <= self._read_s:
            return None
        self._read_s = report.received_s
        board = report.telemetry
        speeds = self._sensors.speeds(report.wheels)
        return self._joints.measured(board.position, board.servo_alive, speeds)

    def speeds(self, now_s: float) -> Array | None:
        """Return the wheel speeds (k,), rad/s, NaN where unmeasured; None without telemetry."""
        report = self._recent(now_s)
        return None if report is None else self._sensors.speeds(report.wheels)

    def write(self, setpoint: Array, now_s: float) -> None:
        """Pass the latest setpoint (n,) to the I/O thread.

        Raises:
            ValueError: If the setpoint has the wrong shape or a value is not finite.
        """
        self._board.command = JointCommand.checked(
            setpoint, self._joints.count, self._heartbeat, now_s
        )
        self._thread.cycle()

    def set_heartbeat(self, heartbeat: Heartbeat) -> None:
        """Set the heartbeat to send with the next setpoint."""
        self._heartbeat = heartbeat

    def fault(self, now_s: float) -> Reason | None:
        """Return the fault of the board or its devices, or None."""
        report = self._board.report
        fault = self._board.health.connection_fault(report and report.received_s, now_s)
        if fault is not None or report is None:
            return fault
        lost = report.lost and (self._sensors.stuck(report.telemetry, report.wheels) or report.lost)
        return self._board.other_robot or self._faults.fault(report.telemetry, lost)

    def battery_v(self, now_s: float) -> float | None:
        """Return the latest battery voltage, or None if unknown."""
        report = self._recent(now_s)
        return None if report is None else report.telemetry.battery_mv / 1000.0

    def servo_c(self, now_s: float) -> float | None:
        """Return the latest temperature of the hottest servo, or None if unknown."""
        report = self._recent(now_s)
        if report is None or not self._expected:
            return None
        return float(max(report.telemetry.temperature[: len(self._joints.names)]))

    def hardware(self) -> dict[str, Any]:
        """Return the hardware section of the status, JSON-serializable."""
        board, report = self._board, self._board.report
        status: dict[str, Any] = {"kind": "mega", "connected": report is not None}
        if report is not None:
            status |= self._status(report.telemetry) | {"firmware": board.firmware}
            status |= self._sensors.status(report.wheels)
            told = [board.battery_warning] if board.battery_warning else []
            if any(report.telemetry.rc) and not board.receiver_expected:
                told.append(_UNEXPECTED_RECEIVER)
            told += board.cables.monitor.sentences() + self._sensors.warnings(report.wheels)
            status["warnings"] = [*told, *board.wiring_faults.values()]
            status["age_ms"] = round(1000.0 * (time.monotonic() - report.received_s), 1)
        return status | {"link": board.health.status()}

    def close(self) -> None:
        """Disarm the board and close the line."""
        self._thread.close()

    def _recent(self, now_s: float) -> BoardTelemetry | None:
        report = self._board.report
        return None if report is None or now_s - report.received_s > SILENT_S else report

    def _status(self, board: Telemetry) -> dict[str, Any]:
        status: dict[str, Any] = {
            "board": MODES.get(board.mode, board.mode),
            "last_trip": self._faults.last_trip(board),
            "past_trips": past_trips(self._board.history, board.nonce[0]),
            "battery_v": round(board.battery_mv / 1000.0, 2),
            "drive_v": round(board.drive_mv / 1000.0, 2),
            "supply_v": round(board.supply_mv / 1000.0, 2),
            "esc_armed": bool(board.esc_ready),
            "pulse_us": self._speed_controllers.pulses_us(board.throttle_out),
            "rc_us": list(board.rc),
            "counters": {name: getattr(board, name) for name in _COUNTERS},
        }
        if self._expected:
            count = len(self._joints.names)
            status["servos"] = {
                "alive": [bool(board.servo_alive >> i & 1) for i in range(count)],
                "missed": self._board.cables.missed[:count],
                "voltage_v": [v / 10.0 for v in board.voltage[:count]],
                "temperature_c": list(board.temperature[:count]),
                "current_a": [round(i / 1000.0, 2) for i in board.current[:count]],
            }
            status["cables"] = self._board.cables.monitor.status()
        return status
