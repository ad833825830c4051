"""Alice drives the robot of `tsd-demo`; Bob requests control, receives it, and drives back."""

import sys
import threading

import tsd_twin


def bob() -> None:
    """Request control, like a second program."""
    with tsd_twin.connect(*sys.argv[1:]) as robot, robot.request_control("bob") as base:
        print(f"{base.operator} has control")
        base.drive(vx_mps=-0.3, duration_s=1.0)


other = threading.Thread(target=bob)
with tsd_twin.connect(*sys.argv[1:]) as robot, robot.control("alice") as base:
    print(f"{base.operator} has control")
    other.start()
    while base.requested_by is None:
        base.set_velocity(vx_mps=0.3)
        robot.sleep(0.05)
    print(f"{base.requested_by} asks for control")
    base.rest()
    base.hand_over()
    other.join()
