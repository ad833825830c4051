"""Simulated robots in virtual time: noisy, delayed measurements and ground truth."""

from __future__ import annotations

from tsd_twin.simulation.actuators import Motors, Servos, SpeedControllers, WheelSurface
from tsd_twin.simulation.factory import PLANTS, plants_of, simulate
from tsd_twin.simulation.robot import (
    BATTERY,
    BoardModel,
    RobotWithStuckJoint,
    SimRobot,
    StuckJoint,
    Truth,
    Wear,
    WornRobot,
)
from tsd_twin.simulation.sensors import Camera, CameraNoise, Frame, Simulation, YawGyro
from tsd_twin.simulation.singularity import KinematicPlant, SingularitySimulation

__all__ = [
    "BATTERY",
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
    "Wear",
    "WheelSurface",
    "WornRobot",
    "YawGyro",
    "plants_of",
    "simulate",
]
