"""Digital twin and remote driving for omnidirectional robots.

```python
import tsd_twin

with tsd_twin.connect() as robot:  # The demo or the mock on this machine.
    print(robot.state.odom.pose)
    with robot.control("script") as base:
        base.drive(vx_mps=0.5, duration_s=1.0)
```

Names are imported when they are first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tsd_twin.client import (
        AsyncRobotClient,
        AsyncRobotControl,
        ClientError,
        ControlDenied,
        ControlLost,
        MotionFailed,
        NoRobotFound,
        RequestRefused,
        RobotClient,
        RobotControl,
        RobotSilent,
        RobotState,
        RobotStopped,
        SeveralRobotsFound,
        SimulatedRobot,
        StopNotConfirmed,
        connect,
        connect_async,
        find,
        find_async,
        stop_all,
        stop_all_async,
    )
    from tsd_twin.errors import RecordingError, TwinError
    from tsd_twin.lie import SE2, SO3
    from tsd_twin.recording import Recording, open_recording
    from tsd_twin.robots import load_robot
    from tsd_twin.simulation import simulate

__version__ = "0.1.0"

_HOMES = {
    "SE2": ("tsd_twin.lie", "SE2"),
    "SO3": ("tsd_twin.lie", "SO3"),
    "TwinError": ("tsd_twin.errors", "TwinError"),
    "Recording": ("tsd_twin.recording", "Recording"),
    "RecordingError": ("tsd_twin.errors", "RecordingError"),
    "load_robot": ("tsd_twin.robots", "load_robot"),
    "open_recording": ("tsd_twin.recording", "open_recording"),
    "simulate": ("tsd_twin.simulation", "simulate"),
}
"""Modules of the public names that are not part of the client."""

__all__ = [
    "SE2",
    "SO3",
    "AsyncRobotClient",
    "AsyncRobotControl",
    "ClientError",
    "ControlDenied",
    "ControlLost",
    "MotionFailed",
    "NoRobotFound",
    "Recording",
    "RecordingError",
    "RequestRefused",
    "RobotClient",
    "RobotControl",
    "RobotSilent",
    "RobotState",
    "RobotStopped",
    "SeveralRobotsFound",
    "SimulatedRobot",
    "StopNotConfirmed",
    "TwinError",
    "__version__",
    "connect",
    "connect_async",
    "find",
    "find_async",
    "load_robot",
    "open_recording",
    "simulate",
    "stop_all",
    "stop_all_async",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'tsd_twin' has no attribute '{name}'")
    module, attribute = _HOMES.get(name, ("tsd_twin.client", name))
    value = getattr(importlib.import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
