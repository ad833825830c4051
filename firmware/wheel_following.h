// Wheels whose measured speed is far from their throttle.
#ifndef WHEEL_FOLLOWING_H
#define WHEEL_FOLLOWING_H

#include <stdbool.h>
#include <stdint.h>

// Call every millisecond; checks one wheel per 4 ms. Deviations count while `driven`.
void wheel_following_tick(bool driven);

// Whether a wheel has been too slow or too fast for too long.
bool wheel_following_stuck(void);

// Copies the number and speeds of this wheel to the table, or clears them.
void wheel_following_report(bool stuck);

#endif
