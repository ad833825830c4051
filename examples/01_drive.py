"""Drive the robot of `tsd-demo` forward by 0.5 m, then turn in place."""

import sys

import tsd_twin

with tsd_twin.connect(*sys.argv[1:]) as robot, robot.control("script") as base:
    base.drive(vx_mps=0.5, duration_s=1.0)
    base.drive(omega_rad_per_s=1.0, duration_s=1.0)
    print(robot.state.odom.pose)
