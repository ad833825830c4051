"""Simulated robots in virtual time: measurements with noise and delay, and the true motion."""

from __future__ import annotations

from tsd_twin.simulation.actuators import Motors, Servos, SpeedControllers, WheelSurface
from tsd_twin.simulation.factory import PLANTS, simulate
from tsd_twin.simulation.robot import BoardModel, RobotWithStuckJoint, SimRobot, StuckJoint, Truth
from tsd_twin.simulation.sensors import Camera, CameraNoise, Frame, YawGyro
from tsd_twin.simulation.singularity import KinematicPlant, SingularitySimulation
from tsd_twin.simulation.wrappers import Simulation

__all__ = [
    "PLANTS",
    "BoardModel",
    "Camera",
    "CameraNoise",
    "Frame",
    "KinematicPlant",
    "Motors",
    "RobotWithStuckJoint",
    "Servos",
    "SimRobot",
    "Simulation",
    "SingularitySimulation",
    "SpeedControllers",
    "StuckJoint",
    "Truth",
    "WheelSurface",
    "YawGyro",
    "simulate",
]
