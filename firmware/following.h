// Following error: whether the gimbals are where they were sent.
#ifndef FOLLOWING_H
#define FOLLOWING_H

#include <stdbool.h>
#include <stdint.h>

// To be called each millisecond: looks at one servo. Errors count while `driven`.
void following_tick(bool driven);

// Bit i: expected servo i is off its goal for too long.
uint8_t following_stuck(void);

#endif
