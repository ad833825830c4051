"""Correct a robot's estimate with a custom pose sensor; print its error without and with it."""

import math

import numpy as np

import tsd_twin


def error_mm(robot: tsd_twin.SimulatedRobot) -> float:
    """Return the distance between estimate and ground truth."""
    state = robot.state
    assert state.truth is not None  # noqa: S101  A simulated robot knows it.
    return 1000.0 * math.dist(state.odom.pose[:2], state.truth.pose[:2])


random = np.random.default_rng(0)
for has_sensor in (False, True):
    with tsd_twin.SimulatedRobot("tsd", seed=0, noise=1.0, errors=1.0) as robot:
        with robot.control("script") as base:
            for _ in range(200):
                base.set_velocity(vx_mps=0.4, omega_rad_per_s=0.5)
                robot.sleep(0.1)
                truth = robot.state.truth
                if has_sensor and truth is not None:
                    x_m, y_m, heading_rad = random.normal(truth.pose, (0.005, 0.005, 0.02))
                    robot.publish_pose(x_m, y_m, heading_rad)
            base.rest()
        print(f"{'with' if has_sensor else 'without'} the sensor: {error_mm(robot):.0f} mm off")
