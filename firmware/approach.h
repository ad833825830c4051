// Approach of the gimbals to their goals: immediate while wheels may spin, slow without a source.
#ifndef APPROACH_H
#define APPROACH_H

#include <stdbool.h>
#include <stdint.h>

// Call every millisecond: applies `goals`, steps from neutral. If `slow`, a servo starts at its
// measured position and moves at 29 degrees per second.
void approach_tick(const int16_t *goals, bool slow);

#endif
