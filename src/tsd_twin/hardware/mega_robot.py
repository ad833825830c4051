"""A machine whose controller board drives the speed controllers and the servos."""

from __future__ import annotations

import time
from typing import Any

from tsd_twin.authority import Mandate
from tsd_twin.hardware.arm_switch import REFUSALS, TRIPS
from tsd_twin.hardware.board import BAUD, Board
from tsd_twin.hardware.calibration import Calibration
from tsd_twin.hardware.joints import Joints, ThrottleLaw
from tsd_twin.hardware.keeper import SILENT_S, Keeper, silence
from tsd_twin.hardware.order import Order
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityRobot
from tsd_twin.wire.blocks import Telemetry
from tsd_twin.wire.codes import SWITCH_US, BoardMode, RcChannel, Refusal

MODES: dict[int, str] = {
    BoardMode.DISARMED: "disarmed",
    BoardMode.ARMED: "armed",
    BoardMode.RC: "radio control",
}


class MegaRobot:
    """The joints of a robot behind one serial line; the face of a `RobotIO`, and guarded.

    Nothing here waits for the line: a thread of its own does, with the newest order.
    """

    def __init__(
        self,
        robot: SingularityRobot,
        port: str,
        throttle: ThrottleLaw,
        calibration: Calibration | None = None,
        *,
        servos: bool = True,
        baud: int = BAUD,
    ) -> None:
        """Connect; without `servos`, others drive them and the board the speed controllers only.

        Raises:
            HardwareError: the board is not there, not ours, does not answer, or does not suffice.
        """
        self._joints = Joints(robot, throttle)
        calibration = calibration or Calibration()
        calibration.check(self._joints.names)
        self._board = Board(self._joints, calibration, servos=servos, baud=baud)
        self._expected = self._joints.servos if servos else 0
        self._mandate = Mandate(False, 0)
        self._read_s = 0.0
        self._keeper = Keeper(port, self._board)

    def read(self, now_s: float) -> Array | None:
        """Return the measured joints (n,), NaN where nothing is measured; None: no news."""
        news = self._board.news
        if news is None or news.heard_s <= self._read_s or now_s - news.heard_s > SILENT_S:
            return None
        self._read_s = news.heard_s
        return self._joints.measured(news.telemetry.position, news.telemetry.servo_alive)

    def write(self, setpoint: Array, now_s: float) -> None:
        """Give the newest set-point (n,) to the thread of the line.

        Raises:
            ValueError: a number is not finite, or there is not one for each joint.
        """
        self._board.order = Order(self._joints.checked(setpoint), self._mandate, now_s)
        self._keeper.cycle()

    def vouch(self, mandate: Mandate) -> None:
        """Say on whose word the next set-point is given."""
        self._mandate = mandate

    def fault(self, now_s: float) -> str:
        """Return what is wrong at the board or below it; "" while all is well."""
        news = self._board.news
        if news is None:
            return f"the controller board is not connected: {self._board.gone}"
        noise = self._board.health.noise
        if noise.fault:
            return noise.fault
        if now_s - news.heard_s > SILENT_S:
            return noise.suspicion or silence(self._board.name)
        return self._objection(news.telemetry, news.lost)

    def hardware(self) -> dict[str, Any]:
        """Return facts for the status that JSON can hold."""
        board, news = self._board, self._board.news
        facts: dict[str, Any] = {"kind": "mega", "connected": news is not None}
        if news is not None:
            facts |= self._facts(news.telemetry)
            facts["age_ms"] = round(1000.0 * (time.monotonic() - news.heard_s), 1)
        return facts | {"link": board.health.status()}

    def close(self) -> None:
        """Disarm the board and close the line."""
        self._keeper.close()

    def _objection(self, said: Telemetry, lost: str) -> str:
        if said.mode == BoardMode.RC:
            return "the radio control has the robot"
        if dead := self._expected & ~said.servo_alive:
            return f"{self._joints.named(dead)}: no answer"
        if broken := self._expected & said.servo_fault:
            return f"{self._joints.named(broken)}: hardware error"
        if lost:
            return lost
        if not said.esc_ready:
            return "the speed controllers have not had zero throttle for 2 s yet"
        if 0 < said.rc[RcChannel.KILL] <= SWITCH_US:
            return REFUSALS[Refusal.KILL]
        if said.rc[RcChannel.MANUAL] > SWITCH_US:
            return "the radio control is switched to manual"
        return ""

    def _facts(self, said: Telemetry) -> dict[str, Any]:
        facts: dict[str, Any] = {
            "board": MODES.get(said.mode, said.mode),
            "last_trip": TRIPS.get(said.trip, said.trip) if said.trip else "none",
            "battery_v": round(said.battery_mv / 1000.0, 2),
            "esc_armed": bool(said.esc_ready),
            "pulse_us": [pulse / 2.0 for pulse in said.throttle_out],
            "rc_us": list(said.rc),
            "counters": {
                "crc_errors": said.crc_errors,
                "rx_errors": said.rx_errors,
                "servo_errors": said.servo_errors,
                "overruns": said.overruns,
                "trips": said.trips,
                "resets": said.resets,
            },
        }
        if self._expected:
            count = len(self._joints.names)
            facts["servos"] = {
                "alive": [bool(said.servo_alive >> i & 1) for i in range(count)],
                "voltage_v": [v / 10.0 for v in said.voltage[:count]],
                "temperature_c": list(said.temperature[:count]),
                "current_a": [round(i / 1000.0, 2) for i in said.current[:count]],
            }
        return facts
