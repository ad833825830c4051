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
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol


class TwinError(Exception):
    """Base class of all intentional errors; programs print them and exit non-zero."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without `__init__`, whose arguments may differ from the base class.

        Otherwise an error that a worker raises breaks its pool of processes.
        """
        return type(self).__new__, (type(self), *self.args), self.__dict__


class RobotFileError(TwinError):
    """A robot description cannot be used."""

    def __init__(self, file: str, problem: str, valid: str = "") -> None:
        self.problem = problem + (f" ({valid})" if valid else "")
        """The problem, without the file."""
        super().__init__(f"{file}: {self.problem}")


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

    def __init__(self, text: str, why: CodedReason | None = None) -> None:
        """`why` is the code with its parameters, if an operator can cause it."""
        super().__init__(text)
        self.why = why


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
    """Names of the packages of an extra; empty without metadata, as in an unpacked wheel."""
    from importlib import metadata  # Takes 20 ms, and 4 MB in every process.

    try:
        requirements = metadata.requires("tsd-twin") or []
    except metadata.PackageNotFoundError:
        return []
    marked = re.compile(rf"([\w.-]+).*;.*\bextra\s*==\s*[\"']{extra}[\"']")
    return [found[1] for text in requirements if (found := marked.match(text))]


def _is_installed(package: str) -> bool:
    from importlib import metadata

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
