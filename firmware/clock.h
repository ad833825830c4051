// Time: a tick per millisecond, and a free-running count of half microseconds.
#ifndef CLOCK_H
#define CLOCK_H

#include <stdbool.h>
#include <stdint.h>

void clock_start(void);

// Takes a pending tick. Ticks are not lost if the main loop is late.
bool clock_tick(void);
// Whether a tick is pending.
bool clock_waiting(void);

// Half microseconds; wraps after 32 ms. Compare only differences smaller than that.
uint16_t clock_half_us(void);

#endif
