"""Errors of this project.

```
TwinError                   anything below; its text is one sentence for the person at the keyboard
├── RobotFileError          a robot description is missing, misspelt or impossible
├── MessageError            a peer sent something that cannot be read (theirs, not ours)
├── BusError                the bus cannot be opened, or is used in a way that is not allowed
│   ├── NoAnswerError       a service did not answer in time
│   └── SeveralAnswersError more than one node answered, so an id is not unique
├── LinkError               a description of a simulated link cannot be read (in link_emulation)
├── PathError               a path that no robot can follow
├── RecordingError          a file is no recording, or lacks a topic
├── MeshError               a generated part is missing or is not a closed solid
├── MissingExtraError       an optional package that was asked for is not installed
└── ClientError             raised by the client library; a refusal has the robot's own sentence
    ├── NoRobotFound        no robot answers at the endpoint
    ├── SeveralRobotsFound  more than one does, and none was named
    ├── ControlDenied       the lease is not granted; `holder` has it
    ├── ControlLost         the lease ended: taken over, handed over or expired
    ├── RequestRefused      the robot refused to arm, reset, set its pose ...
    ├── StopNotConfirmed    robots that did not confirm `stop_all`: `robots`
    ├── RobotStopped        the robot is latched, or began to stop by itself
    ├── RobotSilent         the robot does not answer, or sends no status
    └── MotionFailed        the robot left its path or did not come to rest
```

Any other exception is a bug.
"""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path


class TwinError(Exception):
    """Root of all errors raised on purpose; programs print it and exit non-zero."""


class RobotFileError(TwinError):
    """A robot description cannot be used."""

    def __init__(self, file: str, problem: str, valid: str = "") -> None:
        super().__init__(f"{file}: {problem}" + (f" ({valid})" if valid else ""))


class MessageError(TwinError):
    """A peer sent something that cannot be read; `reason` is the word it is counted under."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason = reason


class BusError(TwinError):
    """The bus cannot be opened, or is used in a way that is not allowed."""


class NoAnswerError(BusError):
    """A service did not answer in time, or no node offers it."""

    def __init__(self, key: str, timeout_s: float) -> None:
        super().__init__(f"{key}: no answer within {timeout_s:g} s")


class SeveralAnswersError(BusError):
    """More than one node answered a request, so it is unknown which one acted on it."""

    def __init__(self, key: str, count: int) -> None:
        super().__init__(f"{key}: {count} nodes answered; give each robot its own id")


class PathError(TwinError):
    """A path that no robot can follow: zero length, a gap, or a corner where none is allowed."""


class RecordingError(TwinError):
    """A file is no recording, or lacks a topic."""


class MeshError(TwinError):
    """A generated part is missing or is not a closed solid."""


class MissingExtraError(TwinError):
    """An optional package is needed and not installed; the message has the command for it."""

    def __init__(self, what: str, extra: str) -> None:
        super().__init__(f"{what} needs an optional package: {install_command(extra)}")


def install_command(extra: str) -> str:
    """Return the shell command that installs the packages of an extra into this environment.

    A checkout is installed once more with the extra. Otherwise the package came from a wheel, which
    may be gone, so the packages of the extra are named.
    """
    install = f"{shlex.quote(sys.executable)} -m pip install"
    checkout = Path(__file__).parents[2]
    if (checkout / "pyproject.toml").is_file():
        return f"{install} -e {shlex.quote(f'{checkout}[{extra}]')}"
    needed = (text.split(";") for text in metadata.requires("tsd-twin") or [])
    marked = re.compile(rf"\bextra\s*==\s*[\"']{extra}[\"']")
    packages = [parts[0].strip() for parts in needed if marked.search(parts[-1])]
    return f"{install} {shlex.join(packages)}"


# The names are those of events, as a script reads them: `except ControlLost`.


class ClientError(TwinError):
    """Base class of the errors of the client library."""


class NoRobotFound(ClientError):  # noqa: N818  Reads as what happened.
    """No robot answers."""


class SeveralRobotsFound(ClientError):  # noqa: N818  Reads as what happened.
    """More than one robot is on the bus, and none was named."""

    def __init__(self, robots: Sequence[str], where: str) -> None:
        super().__init__(
            f"{', '.join(robots)} are at {where}: name one, connect(robot='{robots[0]}')"
        )
        self.robots = tuple(robots)
        """Ids of the robots, sorted."""


class StopNotConfirmed(ClientError):  # noqa: N818  Reads as what happened.
    """Robots did not confirm that they are stopped; the others are."""

    def __init__(self, robots: Sequence[str]) -> None:
        super().__init__(f"no confirmed stop of {', '.join(robots)}: use the emergency stop")
        self.robots = tuple(robots)
        """Ids of the robots that did not confirm, sorted."""


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
