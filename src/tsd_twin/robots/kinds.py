"""The kinds of robots there are: what `kind` in `[drive]` may be, and what it makes of a file."""

from __future__ import annotations

from tsd_twin.robots.omni import OmniRobot
from tsd_twin.robots.robot import Robot
from tsd_twin.robots.singularity import SingularityRobot
from tsd_twin.robots.sphere import SphereRobot

KINDS: dict[str, type[Robot]] = {
    "singularity": SingularityRobot,
    "omni": OmniRobot,
    "sphere": SphereRobot,
}
"""From `drive.kind` to the tables of such a robot."""
