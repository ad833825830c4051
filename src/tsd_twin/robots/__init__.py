"""Descriptions of robots, and the robots that come with the program."""

from tsd_twin.robots.gears import Gears
from tsd_twin.robots.gyro import Gyro
from tsd_twin.robots.kinds import KINDS
from tsd_twin.robots.loader import load, names, of_kind, parse, text
from tsd_twin.robots.omni import OmniRobot
from tsd_twin.robots.robot import JointErrors, OutsidePose, Robot, SpinUp
from tsd_twin.robots.singularity import SingularityRobot
from tsd_twin.robots.sphere import SphereRobot
from tsd_twin.robots.units import RPM

__all__ = [
    "KINDS",
    "RPM",
    "Gears",
    "Gyro",
    "JointErrors",
    "OmniRobot",
    "OutsidePose",
    "Robot",
    "SingularityRobot",
    "SphereRobot",
    "SpinUp",
    "load",
    "names",
    "of_kind",
    "parse",
    "text",
]
