// From a twist to gimbal angles: the same equations as kinematics/singularity.py, for the radio
// control. The PC does its own.
#ifndef KINEMATICS_H
#define KINEMATICS_H

#include <stdint.h>

typedef struct {
  float vx;     // Forward [m/s].
  float vy;     // Left [m/s].
  float omega;  // Counter-clockwise [rad/s].
} twist_t;

// Scales a twist as a whole until no module tilts beyond its limit.
twist_t kinematics_limit(twist_t twist);

// Goals of one module, alpha and beta, in servo steps from neutral.
void kinematics_module(twist_t twist, uint8_t module, int16_t *goals);

#endif
