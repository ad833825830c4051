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

// Call every millisecond: trips, applies permitted commands, and kicks the watchdog.
void safety_tick(void);

#endif
