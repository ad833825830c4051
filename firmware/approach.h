// How gimbals get to their goals: at once while wheels may spin, slowly when nobody drives.
#ifndef APPROACH_H
#define APPROACH_H

#include <stdbool.h>
#include <stdint.h>

// To be called each millisecond: passes `goals`, steps from neutral, on to the servos. When `slow`,
// a servo begins where it is measured, and moves by 29 degrees in a second.
void approach_tick(const int16_t *goals, bool slow);

#endif
