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
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import Protocol


class TwinError(Exception):
    """Base class of all intentional errors; programs print them and exit non-zero."""


class RobotFileError(TwinError):
    """A robot description cannot be used."""

    def __init__(self, file: str, problem: str, valid: str = "") -> None:
        self.problem = problem + (f" ({valid})" if valid else "")
        """The problem, without the file."""
        super().__init__(f"{file}: {self.problem}")


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
    # No robot, or which one.
    "no_robot": "tsd-demo or tsd-mock starts one; connect('tcp/HOST:PORT') names its endpoint",
    "several_robots": "connect(robot='NAME')",
    # The lease.
    "reserved_for": "robot.request_control(), or try again after 3 s",
    "denied_lately": "robot.request_control() after the time that is named",
    "other_request": "robot.request_control() once the other request is answered",
    "no_request": "base.asked_by names who asks, or None",
    "request_of": "base.hand_over(base.asked_by)",
    "take_control_first": "base.acquire(), or enter robot.control() again",
    "held_by": "robot.request_control(), or robot.control(take_over=True, reason='...')",
    "control_denied": "robot.request_control(), or robot.control(take_over=True, reason='...')",
    "no_control": "base.acquire(), or enter robot.control() again",
    # Modes.
    "reset_first": "robot.reset()",
    "robot_stopped": "robot.reset()",
    "robot_fault": "robot.reset()",
    "not_latched": "base.arm(): only a stop or a fault is reset",
    "release_first": "base.rest(), then base.reset()",
    "robot_disarmed": "base.arm()",
    "robot_arming": "base.arm() waits until the robot is ready",
    "wrong_mode": "none if it is ready: drive; otherwise base.rest()",
    "stopped_by_itself": "base.rest(), then the motion again, once the named cause is gone",
    "not_ready": "base.rest(), or base.arm()",
    "arm_refused": "base.arm() once robot.state.status.refusals.arm is None",
    # Motions and settings.
    "other_motion": "base.rest(), or wait in the thread of that motion",
    "no_motion": "base.drive(...), or base.set_velocity(...)",
    "at_rest_only": "base.rest()",
    "no_wheel_speed": "none: only robots with wheels that always spin have one",
    "wheel_speed_refused": "base.set_wheel_speed(rpm) in the range that is named",
    "bad_shape": "the same call with finite numbers in the range of its unit",
    "bad_twist": "base.drive(vx_mps=..., duration_s=...) with finite numbers",
    "bad_frame": "frame='base_link' or frame='odom'",
    "not_finite": "the same call with finite numbers",
    "negative": "the same call with 0 or a positive number",
    "not_positive": "the same call with a positive number",
    "no_number": "the same call with a number",
    "no_string": "the same call with a string",
    "motion_ended": "the motion again",
    "no_such_pose": "SimulatedRobot(...) without pose",
    "goes_nowhere": "base.turn(...)",
    "use_turn": "base.turn(...), or base.set_turn_rate(...)",
    "use_drive": "base.drive(...), or base.set_velocity(...)",
    "left_path": "base.go_to(...) again, from where the robot is now",
    "not_at_rest": "robot.stop()",
    # Silence.
    "stop_unconfirmed": "robot.stop() again, and the stop switch of the robot",
    "connection_of_parent": "tsd_twin.connect() in the child",
    "stops_unconfirmed": "tsd_twin.stop_all() again, and the emergency stop",
    "not_disarmed": "robot.stop() again, and the stop switch of the robot",
    "no_answer": "tsd_twin.connect() again, once the robot and the network run",
    "mode_not_shown": "tsd_twin.connect() again, once the robot and the network run",
    "no_state": "tsd_twin.connect() again, once the robot and the network run",
    "no_status": "tsd_twin.connect() again, once the robot and the network run",
}
"""Calls that resolve what a client raises, by the code of the robot's reason or of the error."""


class CodedReason(Protocol):
    """Reason of a robot: a code of docs/codes.md, and its parameters."""

    @property
    def code(self) -> str:
        """Code."""
        ...

    @property
    def params(self) -> Mapping[str, str | float]:
        """Parameters by name."""
        ...


class ClientError(TwinError):
    """Base class for errors of the client library; the traceback includes the remedy."""

    def __init__(self, sentence: str, code: str, why: CodedReason | None = None) -> None:
        """`why` is the reason of the robot, if it gave one, and `code` that of the error."""
        super().__init__(sentence)
        self.why = why
        """Reason of the robot; None if it gave none."""
        self.code = code if why is None else why.code
        """Code of that reason, as in docs/codes.md; without one, that of the error."""
        self.params: Mapping[str, str | float] = {} if why is None else why.params
        """Parameters of that reason, by name."""
        self.remedy = REMEDIES.get(self.code) or REMEDIES.get(code, "")
        """Call that resolves it; "" if none is known."""
        if self.remedy:
            self.add_note(f"Remedy: {self.remedy}")


class NoRobotFound(ClientError):  # noqa: N818  Named after the event.
    """No robot answers."""


class SeveralRobotsFound(ClientError):  # noqa: N818  Named after the event.
    """Several robots are on the bus, and none was named."""

    def __init__(self, robots: Sequence[str], where: str) -> None:
        super().__init__(
            f"{', '.join(robots)} are at {where}: name one, connect(robot='{robots[0]}')",
            "several_robots",
        )
        self.robots = tuple(robots)
        """Ids of the robots, sorted."""


class StopNotConfirmed(ClientError):  # noqa: N818  Named after the event.
    """Some robots did not confirm that they are stopped; the others did."""

    def __init__(self, robots: Sequence[str]) -> None:
        sentence = f"no confirmed stop of {', '.join(robots)}: use the emergency stop"
        super().__init__(sentence, "stops_unconfirmed")
        self.robots = tuple(robots)
        """Ids of the robots that did not confirm, sorted."""


class ControlDenied(ClientError):  # noqa: N818  Named after the event.
    """The robot does not grant the lease."""

    def __init__(
        self,
        robot: str,
        reason: str,
        holder: str | None = None,
        why: CodedReason | None = None,
    ) -> None:
        super().__init__(f"{robot} gives no control: {reason}", "control_denied", why)
        self.reason = reason
        """The robot's reason."""
        self.holder = holder
        """Operator who has control, if any."""


class ControlLost(ClientError):  # noqa: N818  Named after the event.
    """The lease ended before it was released."""


class RequestRefused(ClientError):  # noqa: N818  Named after the event.
    """The robot refused a request."""

    def __init__(self, robot: str, what: str, reason: str, why: CodedReason | None = None) -> None:
        code = "arm_refused" if what == "arm" else "request_refused"
        super().__init__(f"{robot} refuses to {what}: {reason}", code, why)
        self.reason = reason
        """The robot's reason."""


class RobotStopped(ClientError):  # noqa: N818  Named after the event.
    """The robot is stopped, faulty or not armed, or stopped automatically."""


class RobotSilent(ClientError):  # noqa: N818  Named after the event.
    """The robot does not answer, or has sent no status for a second."""


class MotionFailed(ClientError):  # noqa: N818  Named after the event.
    """The robot did not reach the goal of a motion and was brought to rest."""
