// Who has the joints, and what they get. Everything that moves the robot passes here.
#ifndef SAFETY_H
#define SAFETY_H

#include <stdbool.h>

void safety_start(void);

// A command block was written: a beat if its heartbeat differs from the last.
void safety_command(void);

// To be called each millisecond: trips, hands on what may pass, and kicks the watchdog.
void safety_tick(void);

#endif
