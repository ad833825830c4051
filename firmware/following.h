// Following error: detects gimbals that do not reach their goals.
#ifndef FOLLOWING_H
#define FOLLOWING_H

#include <stdbool.h>
#include <stdint.h>

// Call every millisecond; checks one servo per call. Errors count while `driven`.
void following_tick(bool driven);

// Bit i: expected servo i was off its goal for too long.
uint8_t following_stuck(void);

#endif
