"""A machine whose servos are at the PC, and whose board drives the speed controllers only."""

from __future__ import annotations

import time
from typing import Any

from tsd_twin.authority import Mandate
from tsd_twin.hardware.board import BAUD
from tsd_twin.hardware.calibration import Calibration
from tsd_twin.hardware.joints import Joints, ThrottleLaw
from tsd_twin.hardware.keeper import SILENT_S, Keeper
from tsd_twin.hardware.mega_robot import MegaRobot
from tsd_twin.hardware.order import Order
from tsd_twin.hardware.servo_bus import ServoBus, ServoNews
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityRobot


class U2D2Robot:
    """The joints of a robot behind two serial lines; the face of a `RobotIO`, and guarded."""

    def __init__(
        self,
        robot: SingularityRobot,
        board_port: str,
        servo_port: str,
        throttle: ThrottleLaw,
        calibration: Calibration | None = None,
        *,
        baud: int = BAUD,
    ) -> None:
        """Connect to the board at `board_port` and the servos at `servo_port`.

        Raises:
            HardwareError: something is not there, not ours, or does not answer.
        """
        calibration = calibration or Calibration()
        self._joints = Joints(robot, throttle)
        self._wheels = MegaRobot(robot, board_port, throttle, calibration, servos=False, baud=baud)
        self._bus = ServoBus(self._joints, calibration)
        self._mandate = Mandate(False, 0)
        self._read_s = 0.0
        try:
            self._keeper = Keeper(servo_port, self._bus)
        except Exception:
            self._wheels.close()
            raise

    def read(self, now_s: float) -> Array | None:
        """Return the measured joints (n,), NaN where nothing is measured; None: no news."""
        news = self._bus.news
        if news is None or news.newest_s <= self._read_s or now_s - news.newest_s > SILENT_S:
            return None
        self._read_s = news.newest_s
        return self._joints.measured(self._bus.measured(news), news.alive(now_s))

    def write(self, setpoint: Array, now_s: float) -> None:
        """Give the newest set-point (n,) to both lines.

        Raises:
            ValueError: a number is not finite, or there is not one for each joint.
        """
        self._wheels.write(setpoint, now_s)
        self._bus.order = Order(self._joints.checked(setpoint), self._mandate, now_s)
        self._keeper.cycle()

    def vouch(self, mandate: Mandate) -> None:
        """Say on whose word the next set-point is given."""
        self._mandate = mandate
        self._wheels.vouch(mandate)

    def fault(self, now_s: float) -> str:
        """Return what is wrong with the board, the servos or the lines; "" while all is well."""
        return self._wheels.fault(now_s) or self._servo_fault(now_s)

    def hardware(self) -> dict[str, Any]:
        """Return facts for the status that JSON can hold."""
        facts = self._wheels.hardware() | {"kind": "u2d2"}
        news = self._bus.news
        if news is not None:
            facts["servos"] = self._facts(news)
        return facts | {"servo_link": self._bus.health.status()}

    def close(self) -> None:
        """Shut off the wheels first, then leave the gimbals at neutral."""
        self._wheels.close()
        self._keeper.close()

    def _servo_fault(self, now_s: float) -> str:
        news = self._bus.news
        if news is None:
            return f"the servos are not connected: {self._bus.gone}"
        noise = self._bus.health.noise
        if noise.fault:
            return noise.fault
        if now_s - news.newest_s > SILENT_S:
            return noise.suspicion or f"the servos have not answered for {SILENT_S * 1000:.0f} ms"
        if dead := self._joints.servos & ~news.alive(now_s):
            return f"{self._joints.named(dead)}: no answer"
        if news.faults:
            return f"{self._joints.named(news.faults)}: hardware error"
        return ""

    def _facts(self, news: ServoNews) -> dict[str, Any]:
        alive = news.alive(time.monotonic())
        present = [news.present[i] for i in sorted(news.present)]
        return {
            "alive": [bool(alive >> i & 1) for i in range(len(self._joints.names))],
            "voltage_v": [round(p.voltage_v, 1) for p in present],
            "temperature_c": [p.temperature_c for p in present],
            "current_a": [round(p.current_a, 2) for p in present],
        }
