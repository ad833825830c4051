"""Generator of `robot.h`: robot parameters for driving by radio control.

python firmware/robot.py [NAME_OR_FILE] > firmware/robot.h
"""

from __future__ import annotations

import math
import sys
import textwrap

import numpy as np

from tsd_twin.control.monitors import HOT_MARGIN_C, WARM_MARGIN_C
from tsd_twin.hardware.board_geometry import compiled_geometry
from tsd_twin.hardware.drive_latch import FOLLOWING_SHARE, LAG_S
from tsd_twin.hardware.dynamixel.control_table import ESCS
from tsd_twin.robots import RPM, SingularityDescription, description_of_kind, load_robot
from tsd_twin.simulation import Motors

LAGS = 3.0
"""Time until a wheel has to follow, in time constants of the motor."""


def header(name: str = "tsd") -> str:
    """Return the text of `robot.h`, generated from the description of a robot or its file."""
    robot = description_of_kind(load_robot(name), SingularityDescription)
    drive = robot.kinematics()
    motors = Motors.of(robot)
    cruise = np.full(drive.modules, robot.drive.cruise_speed_rpm * RPM)
    throttles = np.round(2.0 * motors.pulse_us(motors.signal(cruise))).astype(int)
    axles = np.moveaxis(drive.axles(np.eye(3)), 0, -1)
    rows = ",\n".join(
        "    {"
        + ", ".join(
            "{" + ", ".join(f"{x + 0.0:.7f}f" for x in np.round(row, 7)) + "}" for row in module
        )
        + "}"
        for module in axles
    )
    motor_rpm = np.round(
        robot.actuator_offsets().scale[2::3, np.newaxis] * motors.speeds_rad_per_s / RPM
    ).astype(int)
    curve = np.round(2.0 * motors.pulse_us(motors.signals)).astype(int)
    motor_rpm = np.pad(motor_rpm, ((0, ESCS - drive.modules), (0, 0)))
    curves = ",\n".join(f"    {{{', '.join(map(str, row))}}}" for row in motor_rpm)
    lag_s = max(LAG_S, LAGS * max(motors.time_constant_up_s, motors.time_constant_down_s))
    speeds = robot.wheel_speed_range
    limits = robot.limits
    geometry = compiled_geometry(robot)
    compiled = ", ".join(map(str, geometry.pack()))
    values = "\n".join(
        f"//   {item.name}: {getattr(geometry, item.name)}".replace("(", "").replace(")", "")
        for item in geometry.items()
    )
    return f"""\
// Made by `python firmware/robot.py` from the description of `{robot.name}`; do not edit.
#ifndef ROBOT_H
#define ROBOT_H

#include <stdint.h>

#define ROBOT_MODULES {drive.modules}
#define ROBOT_TILT_LIMIT_SINE {math.sin(drive.max_tilt_rad):.9g}f
#define ROBOT_STEPS_PER_RADIAN {robot.servo.steps_per_turn / (2.0 * math.pi):.9g}f
#define ROBOT_SPEED_MPS {limits.speed_mps}f
#define ROBOT_TURN_RATE {limits.turn_rate_rad_per_s}f  // [rad/s]
#define ROBOT_ACCELERATION {limits.acceleration_mps2}f  // [m/s2]
#define ROBOT_ANGULAR_ACCELERATION {limits.angular_acceleration_rad_per_s2}f  // [rad/s2]

// A servo at the second temperature slows the robot down until all are below the first. [deg C]
#define ROBOT_WARM_C {robot.servo_limit_c - WARM_MARGIN_C:.0f}
#define ROBOT_HOT_C {robot.servo_limit_c - HOT_MARGIN_C:.0f}
#define ROBOT_SLOW_SHARE {robot.battery.low_speed_share}f

// Pulses that turn the wheels at cruising speed. [0.5 us]
static const uint16_t ROBOT_CRUISE_THROTTLE[] = {{{", ".join(map(str, throttles))}}};

// Speed of each wheel over the throttle. [0.5 us, rpm]
#define ROBOT_CURVE_POINTS {len(curve)}
static const uint16_t ROBOT_CURVE_THROTTLE[] = {{{", ".join(map(str, curve))}}};
static const uint16_t ROBOT_CURVE_RPM[][ROBOT_CURVE_POINTS] = {{
{curves},
}};
// Lowest speed of a driven wheel; time to follow a setpoint; smallest deviation that counts.
#define ROBOT_WHEEL_START_RPM {speeds.least_rad_per_s / RPM:.0f}
#define ROBOT_WHEEL_LAG_MS {1e3 * lag_s:.0f}
#define ROBOT_WHEEL_LEAST_RPM {FOLLOWING_SHARE * speeds.least_rad_per_s / RPM:.0f}

// (l_x, l_y) of each module from (vx, vy, omega), at cruising speed. [s/m, s/m, s/rad]
static const float ROBOT_AXLES[ROBOT_MODULES][2][3] = {{
{rows},
}};

// Geometry block of the control table, which the bridge compares with the robot file:
{values}
static const uint8_t ROBOT_GEOMETRY[] = {{
    {textwrap.fill(compiled, 92, subsequent_indent="    ")},
}};

#endif
"""


if __name__ == "__main__":
    sys.stdout.write(header(*sys.argv[1:]))
