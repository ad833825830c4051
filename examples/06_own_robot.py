"""Drive a custom robot, described in `06_own_robot.toml`, along an S in virtual time."""

from pathlib import Path

import tsd_twin

DESCRIPTION = Path(__file__).with_suffix(".toml")

with tsd_twin.SimulatedRobot(str(DESCRIPTION), seed=0) as robot:
    wheels = ", ".join(joint.name for joint in robot.description.kinematics().joints)
    print(f"{robot.description.title}: {wheels}")
    with robot.control() as base:
        base.follow_path([(0.5, 0.3), (1.0, 0.0), (1.5, 0.3)], heading_rad=1.57, speed_mps=0.5)
    print(f"after {robot.time_s:.1f} s at {robot.state.odom.pose}")
