"""Plot the gimbal angles for driving in every direction in `gimbals.png`; needs no robot."""

import matplotlib as mpl
import numpy as np

import tsd_twin

mpl.use("Agg")
from matplotlib import pyplot as plt

kinematics = tsd_twin.load_robot("tsd").kinematics()
direction = np.linspace(0.0, 2.0 * np.pi, 361)
twists = np.stack([np.cos(direction), np.sin(direction), np.zeros(361)], axis=-1)
joints = kinematics.inverse(0.5 * twists)

figure, axes = plt.subplots()
for index, joint in enumerate(kinematics.joints):
    if joint.kind == "position":
        axes.plot(np.degrees(direction), np.degrees(joints[:, index]), label=joint.name)
axes.set(xlabel="direction of travel at 0.5 m/s, degrees", ylabel="gimbal angle, degrees")
axes.legend(ncols=2, fontsize="small")
figure.savefig("gimbals.png")
print(f"the largest angle is {np.degrees(np.abs(joints[:, :2]).max()):.2f}°")
