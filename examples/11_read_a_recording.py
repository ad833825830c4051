"""Plot the path of each robot in a recording of tsd-record, and print its length."""

import sys

import numpy as np
from matplotlib.figure import Figure

import tsd_twin


def main() -> None:
    recording = tsd_twin.open_recording(sys.argv[1])
    figure = Figure()
    axes = figure.subplots()
    for robot in recording.robots:
        odom = recording.read("state/odom", robot=robot)
        x_m, y_m = odom["pose.pose.position.x"], odom["pose.pose.position.y"]
        way_m = np.hypot(np.diff(x_m), np.diff(y_m)).sum()
        print(f"{robot} drove {way_m:.2f} m in {recording.duration_s:.1f} s")
        axes.plot(x_m, y_m, label=robot)
    axes.set(xlabel="x, m", ylabel="y, m", aspect="equal")
    axes.legend()
    figure.savefig("way.png")


if __name__ == "__main__":
    main()
