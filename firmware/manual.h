// Driving by radio control: sticks to throttles and gimbal goals, without the PC.
#ifndef MANUAL_H
#define MANUAL_H

#include <stdbool.h>
#include <stdint.h>

#include "control_table.h"

extern uint16_t manual_throttle[CT_ESCS];
extern int16_t manual_goal[CT_SERVOS];

// The stick for the speed of the wheels is at its end: taking over moves nothing.
bool manual_speed_is_zero(void);

// Begins at rest.
void manual_begin(void);

// To be called each millisecond while the radio control has the robot.
void manual_tick(void);

#endif
