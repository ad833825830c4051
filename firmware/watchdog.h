// The watchdog of the chip, and what is remembered over a reset.
#ifndef WATCHDOG_H
#define WATCHDOG_H

#include <stdbool.h>
#include <stdint.h>

#include "hal.h"

// Since power came.
typedef struct {
  uint16_t magic;
  uint16_t trips;
  uint16_t resets;
  bool receiver_seen;
  bool stop_proven;     // The stop circuit was seen open.
  bool wheels_may_spin;  // A throttle was put out, less than the time ago that they run down in.
  uint8_t servos_near;  // Bit i: servo i was seen near its neutral.
} memory_t;

extern memory_t watchdog_memory;

HAL_AT_RESET void watchdog_start(void);

// Why the board started.
uint8_t watchdog_reset_cause(void);

// Counts this start; forgets all when power came.
void watchdog_remember(void);

// To be called by the safety rules only: a loop that spins without them is hung.
void watchdog_kick(void);

#endif
