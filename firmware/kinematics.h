// Inverse kinematics, from twist to gimbal angles, for the radio control. Same equations as
// kinematics/singularity.py, which the PC uses.
#ifndef KINEMATICS_H
#define KINEMATICS_H

#include <stdint.h>

typedef struct {
  float vx;     // Forward [m/s].
  float vy;     // Left [m/s].
  float omega;  // Counter-clockwise [rad/s].
} twist_t;

// Scales a twist so that no module exceeds its tilt limit.
twist_t kinematics_limit(twist_t twist);

// Goals of a module, alpha and beta, in servo steps from neutral.
void kinematics_module(twist_t twist, uint8_t module, int16_t *goals);

#endif
