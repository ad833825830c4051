"""Exceptions of this project.

```
TwinError                   base class; its text is one sentence for the user
├── RobotFileError          a robot description is missing, misspelt or impossible
├── MessageError            a peer sent an unreadable message
├── BusError                the bus cannot be opened, or is used incorrectly
│   ├── NoAnswerError       a service did not answer in time
│   └── SeveralAnswersError several nodes answered, so an id is not unique
├── LinkError               an invalid description of a simulated link (in link_emulation)
├── PathError               a path that no robot can follow
├── RecordingError          a file is not a recording, or lacks a topic
├── MeshError               a generated part is missing or not a closed solid
├── MissingExtraError       a package of an extra is not installed
└── ClientError             raised by the client library; refusals quote the robot's reason
    ├── NoRobotFound        no robot answers at the endpoint
    ├── SeveralRobotsFound  several robots answer, and none was named
    ├── ControlDenied       the lease is not granted; `holder` has it
    ├── ControlLost         the lease ended: taken over, handed over or expired
    ├── RequestRefused      the robot refused to arm, reset, set its pose ...
    ├── StopNotConfirmed    some robots did not confirm `stop_all`: `robots`
    ├── RobotStopped        the robot is latched, or stopped automatically
    ├── RobotSilent         the robot does not answer, or sends no status
    └── MotionFailed        the robot left its path or did not come to rest
```

Any other exception is a bug.
"""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path


class TwinError(Exception):
    """Base class of all intentional errors; programs print them and exit non-zero."""


class RobotFileError(TwinError):
    """A robot description cannot be used."""

    def __init__(self, file: str, problem: str, valid: str = "") -> None:
        super().__init__(f"{file}: {problem}" + (f" ({valid})" if valid else ""))


class MessageError(TwinError):
    """A peer sent an unreadable message; `reason` is the word it is counted under."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason = reason


class BusError(TwinError):
    """The bus cannot be opened, or is used incorrectly."""


class NoAnswerError(BusError):
    """A service did not answer in time, or no node offers it."""

    def __init__(self, key: str, timeout_s: float) -> None:
        super().__init__(f"{key}: no answer within {timeout_s:g} s")


class SeveralAnswersError(BusError):
    """Several nodes answered a request, so it is unknown which one acted on it."""

    def __init__(self, key: str, count: int) -> None:
        super().__init__(f"{key}: {count} nodes answered; give each robot its own id")


class PathError(TwinError):
    """A path that no robot can follow: zero length, a gap, or a forbidden corner."""


class RecordingError(TwinError):
    """A file is not a recording, or lacks a topic."""


class MeshError(TwinError):
    """A generated part is missing or not a closed solid."""


class MissingExtraError(TwinError):
    """A package of an extra is not installed; the message contains the install command."""

    def __init__(self, what: str, extra: str) -> None:
        super().__init__(f"{what} needs the extra `{extra}`: {install_command(extra)}")


@contextmanager
def needs_extra(what: str, extra: str) -> Generator[None]:
    """Import packages of an extra inside this context.

    Raises:
        MissingExtraError: If one is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("tsd_"):
            raise  # A bug, not a missing package.
        raise MissingExtraError(what, extra) from error


def check_extra(what: str, extra: str) -> None:
    """Check that all packages of an extra are installed, without importing them.

    Raises:
        MissingExtraError: If one is not installed.
    """
    if any(not _is_installed(name) for name in _packages(extra)):
        raise MissingExtraError(what, extra)


def _packages(extra: str) -> list[str]:
    """Names of the packages of an extra; none without metadata, as in an unpacked wheel."""
    try:
        requirements = metadata.requires("tsd-twin") or []
    except metadata.PackageNotFoundError:
        return []
    marked = re.compile(rf"([\w.-]+).*;.*\bextra\s*==\s*[\"']{extra}[\"']")
    return [found[1] for text in requirements if (found := marked.match(text))]


def _is_installed(package: str) -> bool:
    try:
        metadata.distribution(package)
    except metadata.PackageNotFoundError:
        return False
    return True


def install_command(extra: str) -> str:
    """Return the shell command that installs an extra into this environment.

    In a checkout, the checkout is installed again. Otherwise pip keeps the installed version and
    adds the packages of the extra.
    """
    install = f"{shlex.quote(sys.executable)} -m pip install"
    checkout = Path(__file__).parents[2]
    if (checkout / "pyproject.toml").is_file():
        return f"{install} -e {shlex.quote(f'{checkout}[{extra}]')}"
    return f"{install} {shlex.quote(f'tsd-twin[{extra}]')}"


# Scripts read these names as events: `except ControlLost`.


REMEDIES: dict[str, str] = {
    # Robot missing or ambiguous.
    "no robot": "tsd-demo or tsd-mock starts one; connect('tcp/HOST:PORT') names its endpoint",
    "name one, connect(robot=": "connect(robot='NAME')",
    # Lease; more specific sentences first.
    "control is kept for": "robot.request_control(), or try again after 3 s",
    "control was kept": "robot.request_control() after the time that is named",
    "asks already": "robot.request_control() once the other request is answered",
    "gives no control": "robot.request_control(), or robot.control(take_over=True, reason='...')",
    "no operator has requested control": "base.asked_by names who asks, or None",
    "it is ... who asks": "base.hand_over(base.asked_by)",
    "no control of": "base.acquire(), or enter robot.control() again",
    "take control first": "base.acquire(), or enter robot.control() again",
    "has control": "robot.request_control(), or robot.control(take_over=True, reason='...')",
    # Modes.
    "reset it first": "robot.reset()",
    "reset first": "robot.reset()",
    "is stopped": "robot.reset()",
    "is fault": "robot.reset()",
    "not stopped": "base.arm(): only a stop or a fault is reset",
    "let go of the stick first": "base.rest(), then base.reset()",
    "is disarmed": "base.arm()",
    "is arming": "base.arm() waits until the robot is ready",
    "is ready already": "none: drive",
    "the robot is ... already": "base.rest()",
    "stopped by itself": "base.rest(), then the motion again, once the named cause is gone",
    "is not ready": "base.rest(), or base.arm()",
    "refuses to arm": "base.arm() once robot.state.status.refusals.arm is None",
    # Motions and settings.
    "is in another motion": "base.rest(), or wait in the thread of that motion",
    "is in no motion": "base.drive(...), or base.set_velocity(...)",
    "can be set at rest only": "base.rest()",
    "have no speed to choose": "none: only robots with wheels that always spin have one",
    "the wheels turn at": "base.set_wheel_speed(rpm) in the range that is named",
    "not a request": "the same call with finite numbers in the range of its unit",
    "a twist is three finite numbers": "base.drive(vx_mps=..., duration_s=...) with finite numbers",
    "frame must be": "frame='base_link' or frame='odom'",
    "must be finite": "the same call with finite numbers",
    "must be at least 0": "the same call with 0 or a positive number",
    "must be greater than 0": "the same call with a positive number",
    "must be a number": "the same call with a number",
    "must be a string": "the same call with a string",
    "rest has ended this motion": "the motion again",
    "has no such pose": "SimulatedRobot(...) without pose",
    "it goes nowhere": "base.turn(...)",
    "use turn, set_turn_rate": "base.turn(...), or base.set_turn_rate(...)",
    "use drive, set_velocity": "base.drive(...), or base.set_velocity(...)",
    "stopped on its way": "base.go_to(...) again, from where the robot is now",
    "does not come to rest": "robot.stop()",
    # Timeouts.
    "did not acknowledge the stop": "robot.stop() again, and the stop switch of the robot",
    "belongs to the parent of this process": "tsd_twin.connect() in the child",
    "no confirmed stop of": "tsd_twin.stop_all() again, and the emergency stop",
    "nor stopped": "robot.stop() again, and the stop switch of the robot",
    "does not answer": "tsd_twin.connect() again, once the robot and the network run",
    "does not show": "tsd_twin.connect() again, once the robot and the network run",
    "sends no state": "tsd_twin.connect() again, once the robot and the network run",
    "has sent no": "tsd_twin.connect() again, once the robot and the network run",
}
"""Remedies for client errors, by a part of the sentence; ... matches any text."""


def remedy_of(sentence: str) -> str:
    """Return the call that resolves a client error, or "" if unknown."""
    return next(
        (
            call
            for part, call in REMEDIES.items()
            if re.search(".*".join(map(re.escape, part.split("..."))), sentence)
        ),
        "",
    )


class ClientError(TwinError):
    """Base class for errors of the client library; the traceback includes the remedy."""

    def __init__(self, sentence: str) -> None:
        super().__init__(sentence)
        self.remedy = remedy_of(sentence)
        """Call that resolves the error, or "" if unknown."""
        if self.remedy:
            self.add_note(f"Remedy: {self.remedy}")


class NoRobotFound(ClientError):  # noqa: N818  Named after the event.
    """No robot answers."""


class SeveralRobotsFound(ClientError):  # noqa: N818  Named after the event.
    """Several robots are on the bus, and none was named."""

    def __init__(self, robots: Sequence[str], where: str) -> None:
        super().__init__(
            f"{', '.join(robots)} are at {where}: name one, connect(robot='{robots[0]}')"
        )
        self.robots = tuple(robots)
        """Ids of the robots, sorted."""


class StopNotConfirmed(ClientError):  # noqa: N818  Named after the event.
    """Some robots did not confirm that they are stopped; the others did."""

    def __init__(self, robots: Sequence[str]) -> None:
        super().__init__(f"no confirmed stop of {', '.join(robots)}: use the emergency stop")
        self.robots = tuple(robots)
        """Ids of the robots that did not confirm, sorted."""


class ControlDenied(ClientError):  # noqa: N818  Named after the event.
    """The robot does not grant the lease."""

    def __init__(self, robot: str, reason: str, holder: str | None = None) -> None:
        super().__init__(f"{robot} gives no control: {reason}")
        self.reason = reason
        """The robot's reason."""
        self.holder = holder
        """Operator who has control, if any."""


class ControlLost(ClientError):  # noqa: N818  Named after the event.
    """The lease ended before it was released."""


class RequestRefused(ClientError):  # noqa: N818  Named after the event.
    """The robot refused a request."""

    def __init__(self, robot: str, what: str, reason: str) -> None:
        super().__init__(f"{robot} refuses to {what}: {reason}")
        self.reason = reason
        """The robot's reason."""


class RobotStopped(ClientError):  # noqa: N818  Named after the event.
    """The robot is stopped, faulty or not armed, or stopped automatically."""


class RobotSilent(ClientError):  # noqa: N818  Named after the event.
    """The robot does not answer, or has sent no status for a second."""


class MotionFailed(ClientError):  # noqa: N818  Named after the event.
    """The robot did not reach the goal of a motion and was brought to rest."""
