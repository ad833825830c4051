// Driving by radio control: sticks to throttles and gimbal goals, without the PC.
#ifndef MANUAL_H
#define MANUAL_H

#include <stdbool.h>
#include <stdint.h>

#include "control_table.h"

extern uint16_t manual_throttle[CT_ESCS];
extern int16_t manual_goal[CT_SERVOS];

// Whether the speed stick is at its low end, so that taking over moves nothing.
bool manual_speed_is_zero(void);

// Starts at rest.
void manual_begin(void);

// Call every millisecond while the radio control drives.
void manual_tick(void);

#endif
