// Time: a tick each millisecond, and a free-running count of half microseconds.
#ifndef CLOCK_H
#define CLOCK_H

#include <stdbool.h>
#include <stdint.h>

void clock_start(void);

// Takes one tick that has not been taken yet. Ticks that the main loop is late for are not lost.
bool clock_tick(void);

// Half microseconds; wraps after 32 ms. Compare differences, and only of less than that.
uint16_t clock_half_us(void);

#endif
