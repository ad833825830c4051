"""Alice drives the robot of `tsd-demo`; Bob asks for control, gets it, and drives it back."""

import sys
import threading

import tsd_twin


def bob() -> None:
    """Ask for control, as a second program would."""
    with tsd_twin.connect(*sys.argv[1:]) as robot, robot.request_control("bob") as base:
        print(f"{base.operator} has control")
        base.drive(vx_mps=-0.3, duration_s=1.0)


other = threading.Thread(target=bob)
with tsd_twin.connect(*sys.argv[1:]) as robot, robot.control("alice") as base:
    print(f"{base.operator} has control")
    other.start()
    while base.asked_by is None:
        base.set_velocity(vx_mps=0.3)
        robot.sleep(0.05)
    print(f"{base.asked_by} asks for control")
    base.rest()
    base.hand_over()
    other.join()
