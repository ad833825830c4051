// Wheel speeds from the telemetry of the speed controllers, with one wire per wheel.
#ifndef WHEEL_TELEMETRY_H
#define WHEEL_TELEMETRY_H

#include <stdint.h>

void wheel_telemetry_start(void);

// Takes the received bytes; called by the interrupt `wheels`.
void wheel_telemetry_take(void);

// Call every millisecond: updates table.wheel_rpm, wheel_age and wheel_measured.
void wheel_telemetry_tick(void);

// Returns a bit for each wheel that sent telemetry since the start.
uint8_t wheel_telemetry_heard(void);

#endif
