#include "kinematics.h"

#include <math.h>

#include "robot.h"

// Horizontal part of the unit axle, linear in the twist: (l_x, l_y) = (-v_y, v_x) / (r_w spin).
static float axle(twist_t twist, uint8_t module, uint8_t part) {
  const float *row = ROBOT_AXLES[module][part];
  return row[0] * twist.vx + row[1] * twist.vy + row[2] * twist.omega;
}

twist_t kinematics_limit(twist_t twist) {
  float worst = 0.0f;
  for (uint8_t i = 0; i < ROBOT_MODULES; i++) {
    worst = fmax(worst, hypot(axle(twist, i, 0), axle(twist, i, 1)));
  }
  if (worst <= ROBOT_TILT_LIMIT_SINE) return twist;
  float share = ROBOT_TILT_LIMIT_SINE / worst;
  return (twist_t){share * twist.vx, share * twist.vy, share * twist.omega};
}

void kinematics_module(twist_t twist, uint8_t module, int16_t *goals) {
  float lx = axle(twist, module, 0), ly = axle(twist, module, 1);
  // Eq. 24 and 25 solved for the angles: alpha = asin(l_y), beta = asin(l_x / cos(alpha)).
  goals[0] = lround(asin(ly) * ROBOT_STEPS_PER_RADIAN);
  goals[1] = lround(asin(lx / sqrt(1.0f - ly * ly)) * ROBOT_STEPS_PER_RADIAN);
}
