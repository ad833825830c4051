"""Descriptions of robots, and the robots that come with the program."""

from tsd_twin.robots.loader import load, names, parse, text
from tsd_twin.robots.robot import RPM, Robot

__all__ = ["RPM", "Robot", "load", "names", "parse", "text"]
