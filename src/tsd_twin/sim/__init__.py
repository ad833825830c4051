"""Simulated robots: what a real one would measure, and the truth apart from it."""

from tsd_twin.sim.board import Board
from tsd_twin.sim.camera import Camera, CameraNoise, Frame
from tsd_twin.sim.esc import SpeedControllers
from tsd_twin.sim.gyro import YawGyro
from tsd_twin.sim.jam import Jam, JammedRobot
from tsd_twin.sim.kinds import PLANTS, simulate
from tsd_twin.sim.motor import Motors
from tsd_twin.sim.plant import KinematicPlant
from tsd_twin.sim.servo import Servos
from tsd_twin.sim.sim_robot import SimRobot, Truth
from tsd_twin.sim.simulation import Simulation
from tsd_twin.sim.singularity import SingularitySimulation
from tsd_twin.sim.wheel_surface import WheelSurface

__all__ = [
    "PLANTS",
    "Board",
    "Camera",
    "CameraNoise",
    "Frame",
    "Jam",
    "JammedRobot",
    "KinematicPlant",
    "Motors",
    "Servos",
    "SimRobot",
    "Simulation",
    "SingularitySimulation",
    "SpeedControllers",
    "Truth",
    "WheelSurface",
    "YawGyro",
    "simulate",
]
