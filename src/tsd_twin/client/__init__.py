"""Client library: connect to a robot, read its state, take control, drive."""

from tsd_twin.client.aio import AsyncRobotClient, AsyncRobotControl, connect_async
from tsd_twin.client.errors import (
    ClientError,
    ControlDenied,
    ControlLost,
    MotionFailed,
    NoRobotFound,
    RequestRefused,
    RobotSilent,
    RobotStopped,
    SeveralRobotsFound,
    StopNotConfirmed,
)
from tsd_twin.client.fleet import find, find_async, stop_all, stop_all_async
from tsd_twin.client.state import OdometryState, PlanarPose, PlanarTwist, RobotState, Subscription
from tsd_twin.client.sync import RobotClient, RobotControl, connect
from tsd_twin.client.virtual import SimulatedRobot

__all__ = [
    "AsyncRobotClient",
    "AsyncRobotControl",
    "ClientError",
    "ControlDenied",
    "ControlLost",
    "MotionFailed",
    "NoRobotFound",
    "OdometryState",
    "PlanarPose",
    "PlanarTwist",
    "RequestRefused",
    "RobotClient",
    "RobotControl",
    "RobotSilent",
    "RobotState",
    "RobotStopped",
    "SeveralRobotsFound",
    "SimulatedRobot",
    "StopNotConfirmed",
    "Subscription",
    "connect",
    "connect_async",
    "find",
    "find_async",
    "stop_all",
    "stop_all_async",
]
