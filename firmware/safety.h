// Arbitration of joint control. All outputs that move the robot pass through here.
#ifndef SAFETY_H
#define SAFETY_H

#include <stdbool.h>

#include "control_table.h"

void safety_start(void);

// Handles a command block; returns whether it has this session's number and is in order. `arm` 0
// always disarms.
bool safety_command(const control_table_t *wanted);

// Whether no source is active and the wheels have run down, so that the setup may be written.
bool safety_at_rest(void);

// Call these every millisecond, in this order: trips and changes of the source;
void safety_tick(void);
// following errors, the radio control and throttle limits;
void safety_follow(void);
// then apply permitted commands, and kick the watchdog.
void safety_put_out(void);

#endif
