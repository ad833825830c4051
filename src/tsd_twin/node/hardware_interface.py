"""Hardware interface of the robot node, which simulator and real robots implement."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.safety import Heartbeat


class RobotIO(Protocol):
    """Hardware interface to the joints of a robot; all calls come from one thread."""

    def read(self, now_s: float) -> Array | None:
        """New measurement, NaN where a value is missing; None when there is none.

        (n + s,): the joints of the drive, then `robot.sensors`, which may be omitted.
        """
        ...

    def write(self, setpoint: Array, now_s: float) -> None:
        """Send the set-point (n,); a wheel speed of zero means zero throttle."""
        ...

    def hardware(self) -> Mapping[str, Any]:
        """Hardware part of the status: `kind`, and diagnostics of the hardware."""
        ...

    def close(self) -> None:
        """Bring the robot to rest and close the connection."""
        ...


@runtime_checkable
class HasWatchdog(Protocol):
    """Hardware with its own command watchdog."""

    def fault(self, now_s: float) -> str:
        """Fault that the board reports, as a part of a sentence; "" without a fault."""
        ...

    def set_heartbeat(self, heartbeat: Heartbeat) -> None:
        """Set the heartbeat that is sent with the next set-point."""
        ...


class Truth(Protocol):
    """True state of a simulated robot."""

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
    """Simulated hardware, whose true motion is known."""

    def truth(self, now_s: float) -> Truth:
        """True pose and twist at `now_s`."""
        ...
