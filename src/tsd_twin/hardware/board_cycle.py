"""Exchange with the controller board: a command and telemetry per cycle, on its I/O thread."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsd_twin.hardware.board_geometry import geometry_fault
from tsd_twin.hardware.cables import BoardCables
from tsd_twin.hardware.controller_board import (
    REST_COMMAND,
    SETTLE_S,
    ArmSwitch,
    handshake,
    read_block,
    read_request,
    restart_reason,
    wiring_faults,
    write_request,
)
from tsd_twin.hardware.dynamixel.control_table import (
    ESCS,
    SERVOS,
    ZERO_THROTTLE,
    BoardCommand,
    BoardIdentity,
    Geometry,
    ReceiverKind,
    Setup,
    Telemetry,
    TripHistory,
    Wheels,
)
from tsd_twin.hardware.dynamixel.packets import StatusPacket
from tsd_twin.hardware.joints import (
    CENTRE,
    JointCommand,
    JointConverter,
    Receiver,
    ServoCalibration,
    padded,
    padded_ids,
)
from tsd_twin.hardware.link_health import LinkHealth
from tsd_twin.hardware.serial_ports import chip_warning
from tsd_twin.hardware.serial_transport import SerialTransport
from tsd_twin.hardware.wheel_sensors import WheelSensors
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.sentences import sentence
from tsd_twin.robots.description import Battery
from tsd_twin.safety import Heartbeat

_LOG = logging.getLogger(__name__)
BAUD = 1_000_000
RESPONSE_TIMEOUT_S = 0.04
"""Response timeout of a cycle; two lost responses stay below `SILENT_S`."""
_LEAVING = 5
_RECOVERED_V = 0.3
"""Warning hysteresis: an unloaded battery recovers by about this voltage."""


@dataclass(frozen=True, slots=True)
class BoardTelemetry:
    """Latest telemetry of the board and its time of receipt."""

    telemetry: Telemetry
    wheels: Wheels
    received_s: float
    lost: Reason | None
    """Reason why the board is disarmed although it should be armed, or None."""


class ControllerBoard:
    """Controller board as the device of a `DeviceThread`.

    Other threads write `command` and read `report`. These are replaced as a whole, so that no
    thread sees a partial update.
    """

    def __init__(
        self,
        joints: JointConverter,
        calibration: ServoCalibration,
        battery: Battery,
        sensors: WheelSensors,
        *,
        geometry: Geometry | None = None,
        servos: bool = True,
        baud: int = BAUD,
    ) -> None:
        """`geometry`: what the firmware must be built for, or None if no radio control can drive;
        `servos`: whether the board drives the servos too, or only the speed controllers.
        """
        self._battery, self._sensors = battery, sensors
        self.cables = BoardCables(joints, joints.servos if servos else 0)
        self.battery_warning = ""
        """Warning while the battery is low, or ""."""
        self.baud = baud
        self.health = LinkHealth("board")
        self.command = JointCommand(np.zeros(joints.count), Heartbeat(False, 0), 0.0)
        self.report: BoardTelemetry | None = None
        self.wiring_faults: dict[str, str] = {}
        """Wiring faults detected so far, by a short name; replaced as a whole."""
        self.firmware = ""
        """Version and build of the firmware."""
        self.history = TripHistory()
        """Last trips; replaced as a whole."""
        self._trips = 0
        """Count of trips when they were read."""
        self.other_robot: Reason | None = None
        """Reason not to arm: the firmware is built for another robot."""
        self._geometry = geometry
        self._was_connected = False
        self._joints = joints
        self._servos = servos
        self._switch = ArmSwitch()
        reverse = [sign < 0 for sign in calibration.signs(joints.names)]
        sticks = calibration.receiver or Receiver()
        self._setup = Setup(
            padded_ids(calibration.ids(joints.names)),
            padded(calibration.neutral(joints.names), SERVOS, CENTRE),
            sum(1 << i for i, turned in enumerate(reverse) if turned),
            joints.goal_limit,
            joints.servos if servos else 0,
            round(1000.0 * battery.arm_v),
            round(1000.0 * battery.stop_v),
            calibration.bandgap_mv,
            int(calibration.receiver is not None),
            stick_low=sticks.low_us,
            stick_centre=sticks.centre_us,
            stick_high=sticks.high_us,
            stick_dead=sticks.dead_us,
            receiver_kind=ReceiverKind[sticks.kind.upper()],
            receiver_map=sticks.map,
            pulse_low=_half_us(calibration.speed_controllers.low_us),
            pulse_high=_half_us(calibration.speed_controllers.high_us),
            throttle_limit=padded(joints.throttle_limit, ESCS, ZERO_THROTTLE),
            throttle_rise=joints.throttle_rise,
            wheel_sensor=sensors.kind,
            wheel_pulses=sensors.pulses,
        )
        self.receiver_expected = calibration.receiver is not None

    def connect(self, transport: SerialTransport) -> None:
        """Check model and control table version, and configure the board.

        Raises:
            HardwareError: If it is another device or does not respond.
        """
        telemetry = handshake(transport, self._setup, self.baud)
        identity = read_block(transport, BoardIdentity)
        self.firmware = f"{identity.fw}, build {identity.build:08x}"
        if self._geometry is not None:
            built_for = read_block(transport, Geometry)
            self.other_robot = geometry_fault(built_for, self._geometry)
        self.history, self._trips = read_block(transport, TripHistory), telemetry.trips
        self._find_wiring_faults(telemetry, opened=self.report is None)
        self._warn("usb chip", chip_warning(transport.name, self.baud))
        self._was_connected = True
        self.report = BoardTelemetry(telemetry, Wheels(), time.monotonic(), self._switch.lost)

    def cycle(self, transport: SerialTransport) -> bool:
        """Write the command and read telemetry in one exchange; return whether it succeeded.

        The echoed heartbeat shows that the response belongs to this request.

        Raises:
            HardwareError: If the port is gone, or the board restarted and failed the handshake.
        """
        began_s = time.monotonic()
        before, broken = self.report, transport.broken
        command = self._board_command(self.command, began_s)
        request = write_request(command) + self._sensors.request
        answers = transport.request(request, 2, RESPONSE_TIMEOUT_S)
        now_s = time.monotonic()
        seen, corrupt = self._parsed(answers), transport.broken > broken
        if seen is None or seen[0].beat != command.heartbeat:
            self.health.add_timeout()
            self._add_cycle(corrupt, now_s)
            # Drain late responses, or all later ones would be late too.
            if answers and not corrupt:
                transport.drain(SETTLE_S)
            return False
        self.health.add_round_trip(now_s - began_s)
        telemetry, wheels = seen
        if before is not None and _restarted(before.telemetry, telemetry):
            reason = restart_reason(telemetry.reset_cause)
            _LOG.warning("%s", sentence(reason))
            self._switch.mark_lost(reason)
            self.connect(transport)
        elif before is not None:
            corrupt = corrupt or _has_receive_errors(before.telemetry, telemetry)
        self._add_cycle(corrupt, now_s)
        self._switch.update(telemetry)
        if before is not None:
            self.cables.add(before.telemetry, telemetry, now_s)
        self._find_wiring_faults(telemetry, opened=False)
        self._watch_battery(telemetry.battery_mv / 1000.0)
        self.report = BoardTelemetry(telemetry, wheels, now_s, self._switch.lost)
        if telemetry.trips != self._trips:
            self._read_history(transport, telemetry.trips)
        return True

    def disconnected(self) -> None:
        """Discard the report; the board stays disarmed after it reconnects."""
        self._switch.mark_lost(because(Code.BOARD_LOST))
        self.cables.monitor.add_reconnect()
        self.report = None

    def rest(self, transport: SerialTransport) -> None:
        """Disarm the board, retrying if it does not respond."""
        for _ in range(_LEAVING):
            if transport.request(write_request(REST_COMMAND), 1, RESPONSE_TIMEOUT_S):
                return

    def _read_history(self, transport: SerialTransport, trips: int) -> None:
        """Read the last trips in one exchange; without an answer, the next cycle tries again."""
        answers = transport.request(read_request(TripHistory), 1, RESPONSE_TIMEOUT_S)
        if [len(answer.data) for answer in answers] == [TripHistory.LAYOUT.size]:
            self.history, self._trips = TripHistory.unpack(answers[0].data), trips
        else:
            transport.drain(SETTLE_S)

    def _parsed(self, answers: list[StatusPacket]) -> tuple[Telemetry, Wheels] | None:
        """Return the measurements if the responses are from one write and one read."""
        if [bool(answer.data) for answer in answers] != [False, True]:
            return None
        return self._sensors.parse(answers[1].data)

    def _find_wiring_faults(self, telemetry: Telemetry, *, opened: bool) -> None:
        found = wiring_faults(telemetry, opened=opened, returned=self._was_connected)
        for name, text in found.items():
            self._warn(name, text)

    def _warn(self, name: str, text: str) -> None:
        if text and name not in self.wiring_faults:
            _LOG.warning("%s", text)
            self.wiring_faults = {**self.wiring_faults, name: text}

    def _watch_battery(self, volts: float) -> None:
        warn_v = self._battery.warn_v
        if volts < warn_v and not self.battery_warning:
            self.battery_warning = sentence(because(Code.BATTERY_LOW, volts=warn_v))
            _LOG.warning("%s", self.battery_warning)
        elif volts > warn_v + _RECOVERED_V:
            self.battery_warning = ""

    def _add_cycle(self, corrupt: bool, now_s: float) -> None:
        self.health.add_packets(corrupt, now_s)
        if (fault := self.health.packet_fault) is not None:
            self._switch.mark_lost(fault)

    def _board_command(self, wanted: JointCommand, now_s: float) -> BoardCommand:
        if not wanted.in_force(now_s):
            self._switch.mark_lost(because(Code.NODE_HANGS))
            return REST_COMMAND
        armed = wanted.heartbeat.armed and self.other_robot is None
        arm = self._switch.turn(armed, stop=wanted.heartbeat.stopped)
        goals = self._joints.goals(wanted.setpoint) if self._servos else ()
        return BoardCommand(
            heartbeat=wanted.heartbeat.counter & 0xFFFF,
            arm=arm,
            throttle=padded(self._joints.throttles(wanted.setpoint), ESCS, ZERO_THROTTLE),
            goal=padded(goals, SERVOS, 0),
            session=self.report.telemetry.nonce if self.report else (0, 0),
        )


def _half_us(pulses_us: Sequence[float]) -> tuple[int, ...]:
    return tuple(round(2.0 * pulse_us) for pulse_us in pulses_us)


def _restarted(before: Telemetry, after: Telemetry) -> bool:
    """Return whether the board was reset since the last cycle; its clock wraps after 50 days."""
    back_ms = before.millis - after.millis
    return after.resets != before.resets or 0 < back_ms < 1 << 31


def _has_receive_errors(before: Telemetry, after: Telemetry) -> bool:
    """Return whether the board counted receive errors since the last cycle."""
    return (before.crc_errors, before.rx_errors) != (after.crc_errors, after.rx_errors)
