// The six gimbal servos: finds them, gives them goals and reads them, once in each cycle.
#ifndef SERVOS_H
#define SERVOS_H

#include <stdbool.h>
#include <stdint.h>

#include "control_table.h"

#define SERVOS_CYCLE_MS 10

// What the safety rules let through: steps from neutral, and the mask of servos that hold.
typedef struct {
  int16_t goal[CT_SERVOS];
  uint8_t torque;
} servo_command_t;

extern servo_command_t servo_command;

void servos_start(void);

// To be called before the ids in the table change: forgets what it knew of the servos.
void servos_renumber(void);

// Goes on with the request that is under way; to be called whenever something happened.
void servos_poll(void);

// To be called each millisecond.
void servos_tick(void);

#endif
