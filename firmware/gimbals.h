// Mounting of the servos at the gimbals: neutral positions and directions.
#ifndef GIMBALS_H
#define GIMBALS_H

#include <stdint.h>

#include "servo.h"

// Position of servo `i`, 0 to 4095, for steps from neutral.
uint16_t gimbals_goal(uint8_t i, int16_t steps);

// Call at the start, and after ids or neutral positions change. A servo gets torque once it was
// near neutral.
void gimbals_forget(void);
void gimbals_start(void);

// Updates the table with a report of servo `i`.
void gimbals_report(uint8_t i, const servo_report_t *report);

#endif
