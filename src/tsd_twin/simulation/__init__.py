"""Simulated robots in virtual time: noisy, delayed measurements and ground truth."""

from __future__ import annotations

from tsd_twin.simulation.actuators import EscModel, Motors, Servos, WheelSurface
from tsd_twin.simulation.base import Simulation
from tsd_twin.simulation.factory import PLANTS, plants_of, simulate
from tsd_twin.simulation.robot import BoardModel, SimRobot, SimulationTruth
from tsd_twin.simulation.singularity import SingularitySimulation, rolling_tangent
from tsd_twin.simulation.wear import BATTERY, DegradedRobot, StuckJoint, Wear

__all__ = [
    "BATTERY",
    "PLANTS",
    "BoardModel",
    "DegradedRobot",
    "EscModel",
    "Motors",
    "Servos",
    "SimRobot",
    "Simulation",
    "SimulationTruth",
    "SingularitySimulation",
    "StuckJoint",
    "Wear",
    "WheelSurface",
    "plants_of",
    "rolling_tangent",
    "simulate",
]
