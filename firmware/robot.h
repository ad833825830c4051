// Made by `python firmware/robot.py` from the description of `tsd`; do not edit.
#ifndef ROBOT_H
#define ROBOT_H

#include <stdint.h>

#define ROBOT_MODULES 3
#define ROBOT_TILT_LIMIT_SINE 0.5f
#define ROBOT_STEPS_PER_RADIAN 651.898647f
#define ROBOT_SPEED_MPS 1.0f
#define ROBOT_TURN_RATE 3.0f  // [rad/s]
#define ROBOT_ACCELERATION 4.0f  // [m/s2]
#define ROBOT_ANGULAR_ACCELERATION 20.0f  // [rad/s2]

// A servo at the second temperature slows the robot down until all are below the first. [deg C]
#define ROBOT_WARM_C 65
#define ROBOT_HOT_C 70
#define ROBOT_SLOW_SHARE 0.5f

// Pulses that turn the wheels at cruising speed. [0.5 us]
static const uint16_t ROBOT_CRUISE_THROTTLE[] = {2414, 2411, 2417};

// Speed of each wheel over the throttle. [0.5 us, rpm]
#define ROBOT_CURVE_POINTS 10
static const uint16_t ROBOT_CURVE_THROTTLE[] = {2000, 2222, 2444, 2667, 2889, 3111, 3333, 3556, 3778, 4000};
static const uint16_t ROBOT_CURVE_RPM[][ROBOT_CURVE_POINTS] = {
    {0, 0, 2892, 4137, 5895, 7264, 8419, 10113, 11927, 13603},
    {0, 0, 2938, 4762, 5768, 7019, 9016, 10205, 11898, 13445},
    {0, 0, 2856, 4322, 6147, 7121, 8804, 10353, 11785, 13409},
};
// Lowest speed of a driven wheel; time to follow a setpoint; smallest deviation that counts.
#define ROBOT_WHEEL_START_RPM 2000
#define ROBOT_WHEEL_LAG_MS 900
#define ROBOT_WHEEL_LEAST_RPM 500

// (l_x, l_y) of each module from (vx, vy, omega), at cruising speed. [s/m, s/m, s/rad]
static const float ROBOT_AXLES[ROBOT_MODULES][2][3] = {
    {{0.0000000f, -0.0954930f, 0.0000000f}, {0.0954930f, 0.0000000f, -0.0143239f}},
    {{0.0826993f, 0.0477465f, 0.0000000f}, {-0.0477465f, 0.0826993f, -0.0143239f}},
    {{-0.0826993f, 0.0477465f, 0.0000000f}, {-0.0477465f, -0.0826993f, -0.0143239f}},
};

// Geometry block of the control table, which the bridge compares with the robot file:
//   wheel_radius_um: 40000
//   pivot_x: 0, -1299, 1299
//   pivot_y: 1500, -750, -750
//   cruise_rpm: 2500, 2500, 2500
//   max_tilt: 3000
//   servo_steps: 4096
//   speed: 1000
//   turn_rate: 3000
//   acceleration: 4000
//   angular_acceleration: 2000
static const uint8_t ROBOT_GEOMETRY[] = {
    64, 156, 0, 0, 0, 0, 237, 250, 19, 5, 220, 5, 18, 253, 18, 253, 196, 9, 196, 9, 196, 9, 184,
    11, 0, 16, 232, 3, 184, 11, 160, 15, 208, 7,
};

#endif
