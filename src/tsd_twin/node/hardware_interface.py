"""Hardware interface of the robot node, which simulator and real robots implement."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.safety import Heartbeat


class RobotIO(Protocol):
    """Joints of a robot; all calls come from one thread."""

    def read(self, now_s: float) -> Array | None:
        """Return what is measured, NaN where a number is not; None: no news.

        (n + s,): the joints of the drive, then `robot.sensors`, which may be left out.
        """
        ...

    def write(self, setpoint: Array, now_s: float) -> None:
        """Pass on the set-point (n,); a wheel speed of zero means zero throttle."""
        ...

    def hardware(self) -> Mapping[str, Any]:
        """Return what the status says about the hardware: `kind` and what else there is."""
        ...

    def close(self) -> None:
        """Leave the robot at rest."""
        ...


@runtime_checkable
class HasWatchdog(Protocol):
    """A robot with a board that stops by itself when nobody stands behind what it is told."""

    def fault(self, now_s: float) -> str:
        """Return what the board objects to, as a part of a sentence; "" while all is well."""
        ...

    def set_heartbeat(self, heartbeat: Heartbeat) -> None:
        """Say on whose word the next set-point is given."""
        ...


class Truth(Protocol):
    """Where a simulated robot really is."""

    @property
    def pose(self) -> SE2 | SO3:
        """Pose in the world."""
        ...

    @property
    def twist(self) -> Array:
        """(3,): in the base frame."""
        ...


@runtime_checkable
class HasTruth(Protocol):
    """A robot whose true motion is known."""

    def truth(self, now_s: float) -> Truth:
        """Return where the robot really is."""
        ...
