"""Simulated robots in virtual time: noisy, delayed measurements and ground truth."""

from __future__ import annotations

from tsd_twin.simulation.actuators import Motors, Servos, SpeedControllers, WheelSurface
from tsd_twin.simulation.base import Simulation
from tsd_twin.simulation.factory import PLANTS, plants_of, simulate
from tsd_twin.simulation.robot import BoardModel, SimRobot, Truth
from tsd_twin.simulation.singularity import KinematicPlant, SingularitySimulation
from tsd_twin.simulation.wear import BATTERY, RobotWithStuckJoint, StuckJoint, Wear, WornRobot

__all__ = [
    "BATTERY",
    "PLANTS",
    "BoardModel",
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
    "plants_of",
    "simulate",
]
