"""Errors of the client library; a refusal carries the robot's own message.

```
ClientError             anything below, itself below TwinError
├── NoRobotFound        no robot answers at the endpoint
├── SeveralRobotsFound  more than one does, and none was named
├── ControlDenied       the lease is not granted; `holder` has it
├── ControlLost         the lease ended: taken over, handed over or expired
├── RequestRefused      the robot refused to arm, reset, set its pose ...
├── RobotStopped        the robot is latched, or began to stop by itself
├── RobotSilent         the robot does not answer, or sends no status
└── MotionFailed        the robot left its path or did not come to rest
```
"""

from tsd_twin.errors import TwinError

# The names are those of events, as a script reads them: `except ControlLost`.


class ClientError(TwinError):
    """Base class of the errors of the client library."""


class NoRobotFound(ClientError):  # noqa: N818  Reads as what happened.
    """No robot answers."""


class SeveralRobotsFound(ClientError):  # noqa: N818  Reads as what happened.
    """More than one robot is on the bus, and none was named."""


class ControlDenied(ClientError):  # noqa: N818  Reads as what happened.
    """The robot does not grant the lease."""

    def __init__(self, robot: str, reason: str, holder: str | None = None) -> None:
        super().__init__(f"{robot} gives no control: {reason}")
        self.reason = reason
        """The robot's own sentence."""
        self.holder = holder
        """The operator who has control, if any."""


class ControlLost(ClientError):  # noqa: N818  Reads as what happened.
    """The lease ended before it was released."""


class RequestRefused(ClientError):  # noqa: N818  Reads as what happened.
    """The robot refused a request."""

    def __init__(self, robot: str, what: str, reason: str) -> None:
        super().__init__(f"{robot} refuses to {what}: {reason}")
        self.reason = reason
        """The robot's own sentence."""


class RobotStopped(ClientError):  # noqa: N818  Reads as what happened.
    """The robot is stopped or faulty, is not armed, or began to stop by itself."""


class RobotSilent(ClientError):  # noqa: N818  Reads as what happened.
    """The robot does not answer, or has sent no status for a second."""


class MotionFailed(ClientError):  # noqa: N818  Reads as what happened.
    """The robot did not reach the goal of a motion; it was brought to rest."""
