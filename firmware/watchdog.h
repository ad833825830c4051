// Watchdog of the chip, and variables that survive a reset.
#ifndef WATCHDOG_H
#define WATCHDOG_H

#include <stdbool.h>
#include <stdint.h>

#include "hal.h"

// Since power-on.
typedef struct {
  uint16_t magic;
  uint16_t trips;
  uint16_t resets;
  bool receiver_seen;
  bool stop_proven;     // The stop circuit was open at least once.
  bool wheels_may_spin;  // A throttle was output within the run-down time of the wheels.
  uint8_t servos_near;  // Bit i: servo i was near its neutral.
} memory_t;

extern memory_t watchdog_memory;

HAL_AT_RESET void watchdog_start(void);

// Cause of the last reset.
uint8_t watchdog_reset_cause(void);

// Counts this start; clears everything after power-on.
void watchdog_remember(void);

// Call from the safety rules only, because a loop without them counts as hung.
void watchdog_kick(void);

#endif
