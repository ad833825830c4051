"""Drive a thousand robots with noisy motors two metres at once, and print their spread."""

import time

import numpy as np

import tsd_twin

PERIOD_S, COUNT = 0.01, 1000

description = tsd_twin.load_robot("tsd")
robots = tsd_twin.simulate(description, (COUNT,), seed=0, noise=1.0, errors=1.0)
kinematics = robots.kinematics
twist = np.zeros((COUNT, 3))

began_s = time.perf_counter()
for tick in range(round(9.0 / PERIOD_S)):
    now_s = tick * PERIOD_S
    # Speed controllers require zero throttle for two seconds; then the wheels spin up.
    twist[:, 0] = 0.5 if 4.0 <= now_s < 8.0 else 0.0
    setpoint = kinematics.inverse(twist)
    if now_s < 2.5:
        setpoint[:] = 0.0
    robots.command(setpoint)
    robots.advance(PERIOD_S)
took_s = time.perf_counter() - began_s

x_m, y_m, heading_rad = robots.pose.xy_heading.T
print(f"x {x_m.mean():.2f} m ± {1000 * x_m.std():.0f} mm, y ± {1000 * y_m.std():.0f} mm")
print(f"{COUNT} robots, {COUNT * 9.0 / took_s:,.0f} times faster than real time")
