"""Follow a figure of eight with the robot of `tsd-demo`, and print the path error."""

import sys

import numpy as np

import tsd_twin

turn = np.linspace(0.0, 2.0 * np.pi, 60)[1:]

with tsd_twin.connect(*sys.argv[1:]) as robot, robot.control("script") as base:
    start = robot.state.odom.pose
    line = np.stack([start.x_m + 0.4 * np.sin(turn), start.y_m + 0.2 * np.sin(2.0 * turn)], axis=-1)
    passed: list[tuple[float, float]] = []
    watching = robot.on_state(lambda state: passed.append(state.odom.pose[:2]), maxlen=50)
    base.follow_path(line.tolist())
    watching.close()
    off_m = np.linalg.norm(np.array(passed)[:, None] - line, axis=-1).min(axis=1)
    print(f"at most {1000 * off_m.max():.0f} mm from the nearest of {len(line)} points")
