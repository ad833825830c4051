// Who has the joints, and what they get. Everything that moves the robot passes here.
#ifndef SAFETY_H
#define SAFETY_H

#include <stdbool.h>

#include "control_table.h"

void safety_start(void);

// A command block was written; returns whether it is of this session and in its order. With 0 in
// `arm` it disarms in any case.
bool safety_command(const control_table_t *wanted);

// Without a source, and the wheels have run down: it may be set up.
bool safety_at_rest(void);

// To be called each millisecond: trips, hands on what may pass, and kicks the watchdog.
void safety_tick(void);

#endif
