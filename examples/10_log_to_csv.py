"""Log pose and joints of the robot of `tsd-demo` to `log.csv` for two seconds."""

import csv
import sys
from pathlib import Path

import tsd_twin

with tsd_twin.connect(*sys.argv[1:]) as robot, Path("log.csv").open("w", newline="") as file:
    log = csv.writer(file)
    log.writerow(["stamp_s", "mode", "x_m", "y_m", "heading_rad", *robot.state.joints.names])
    for rows, state in enumerate(robot.states(2.0), start=1):
        joints = state.joints.position_rad
        log.writerow([f"{state.odom.stamp_s:.3f}", state.mode.value, *state.odom.pose, *joints])
        print(f"\r{rows} rows", end="")
print(" in log.csv")
