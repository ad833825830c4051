// How servos sit at the gimbals: where neutral is, and which turn the other way.
#ifndef GIMBALS_H
#define GIMBALS_H

#include <stdint.h>

#include "servo.h"

// Position of servo `i`, 0 to 4095, for steps from neutral.
uint16_t gimbals_goal(uint8_t i, int16_t steps);

// To be called at the start, and after ids or neutral positions in the table have changed: a servo
// gets torque once it has been seen near its neutral.
void gimbals_forget(void);
void gimbals_start(void);

// Brings the table up to date with what servo `i` reports.
void gimbals_report(uint8_t i, const servo_report_t *report);

#endif
