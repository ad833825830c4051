"""Visit the corners of a square with the robot of `tsd-demo`, facing its centre at each."""

import math
import sys

import tsd_twin

CORNERS_M = [(0.5, 0.0), (0.5, 0.5), (0.0, 0.5), (0.0, 0.0)]

with tsd_twin.connect(*sys.argv[1:]) as robot, robot.control("script") as base:
    for x_m, y_m in CORNERS_M:
        heading_rad = math.atan2(0.25 - y_m, 0.25 - x_m)
        base.go_to(x_m=x_m, y_m=y_m, heading_rad=heading_rad)
        pose = robot.state.odom.pose
        print(f"at {pose.x_m:.3f} m, {pose.y_m:.3f} m, {math.degrees(pose.heading_rad):.0f}°")
