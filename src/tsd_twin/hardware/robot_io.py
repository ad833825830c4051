"""Hardware interface of a robot, which drivers and the simulation satisfy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.codes import Reason
from tsd_twin.safety import Heartbeat


class RobotIO(Protocol):
    """Hardware interface to a robot's joints; called from a single thread."""

    def read(self, now_s: float) -> Array | None:
        """Return a new measurement, or None if nothing was measured; missing values are NaN.

        (n + s,): drive joints, then `robot.sensors`, which may be omitted.
        """
        ...

    def write(self, setpoint: Array, now_s: float) -> None:
        """Send the setpoint (n,); a wheel speed of zero means zero throttle."""
        ...

    def hardware(self) -> Mapping[str, Any]:
        """Return the hardware part of the status: `kind` and diagnostics."""
        ...

    def close(self) -> None:
        """Stop the robot and close the connection."""
        ...


@runtime_checkable
class HasWatchdog(Protocol):
    """Hardware with its own command watchdog."""

    def fault(self, now_s: float) -> Reason | str | None:
        """Fault that the board reports, also as a text; None or "" without a fault."""
        ...

    def set_heartbeat(self, heartbeat: Heartbeat) -> None:
        """Set the heartbeat sent with the next setpoint."""
        ...


@runtime_checkable
class HasBattery(Protocol):
    """Hardware that measures the battery voltage."""

    def battery_v(self, now_s: float) -> float | None:
        """Return the latest battery voltage, or None if unknown."""
        ...


@runtime_checkable
class HasServoTemperature(Protocol):
    """Hardware that measures servo temperatures."""

    def servo_c(self, now_s: float) -> float | None:
        """Return the latest temperature of the hottest servo, or None if unknown."""
        ...


class Truth(Protocol):
    """Ground-truth state of a simulated robot."""

    @property
    def pose(self) -> SE2 | SO3:
        """Pose in the world."""
        ...

    @property
    def twist(self) -> Array:
        """(3,): twist in the base frame."""
        ...


@runtime_checkable
class HasTruth(Protocol):
    """Simulated hardware with known ground truth."""

    def truth(self, now_s: float) -> Truth:
        """Return the true pose and twist at `now_s`."""
        ...
