// Wheel speeds, measured by sensors with one wire of pulses per wheel, or by the speed controllers.
#ifndef WHEEL_SPEED_H
#define WHEEL_SPEED_H

#include <stdint.h>

// Call every millisecond: updates table.wheel_rpm, wheel_age and wheel_measured.
void wheel_speed_tick(void);

// Returns a bit for each wheel whose speed was measured since the start: its sensor works, or has failed.
uint8_t wheel_speed_expected(void);

#endif
