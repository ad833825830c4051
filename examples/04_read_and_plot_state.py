"""Drive a circle with the robot of `tsd-demo`, and plot speed and gimbal angles in `state.png`."""

import sys

import matplotlib as mpl
import numpy as np

import tsd_twin

mpl.use("Agg")
from matplotlib import pyplot as plt

seen: list[tsd_twin.RobotState] = []
with tsd_twin.connect(*sys.argv[1:]) as robot, robot.control("script") as base:
    watching = robot.on_state(seen.append, maxlen=50)
    base.drive(vx_mps=0.4, omega_rad_per_s=1.0, duration_s=2.0)
    watching.close()

time_s = np.array([state.odom.stamp_s - seen[0].odom.stamp_s for state in seen])
speed_mps = [np.hypot(*state.odom.twist[:2]) for state in seen]
angles_deg = np.degrees([state.joints.position_rad for state in seen])
figure, (above, below) = plt.subplots(2, 1, sharex=True)
above.plot(time_s, speed_mps)
above.set_ylabel("speed, m/s")
below.plot(time_s, angles_deg)
below.set(xlabel="time, s", ylabel="gimbal angles, degrees")
figure.savefig("state.png")
print(f"{len(seen)} states in state.png")
