// The six gimbal servos: finds them, sends goals and reads measurements, once per cycle.
#ifndef SERVOS_H
#define SERVOS_H

#include <stdbool.h>
#include <stdint.h>

#include "control_table.h"

#define SERVOS_CYCLE_MS 10

// Output of the safety rules: goals in steps from neutral, and mask of servos with torque.
typedef struct {
  int16_t goal[CT_SERVOS];
  uint8_t torque;
} servo_command_t;

extern servo_command_t servo_command;

void servos_start(void);

// Call before the ids in the table change: discards all knowledge about the servos.
void servos_renumber(void);

// Continues the current request; call after every event.
void servos_poll(void);

// Call every millisecond.
void servos_tick(void);

#endif
