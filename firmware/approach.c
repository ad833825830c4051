#include "approach.h"

#include "control_table.h"
#include "servos.h"
#include "table.h"

#define STEP_MS 3  // One step of 0.088 degrees per STEP_MS.

static uint8_t since_step_ms;

static int16_t one_step(int16_t from, int16_t to) {
  if (from < to) return from + 1;
  return from > to ? from - 1 : from;
}

void approach_tick(const int16_t *goals, bool slow) {
  bool step = ++since_step_ms >= STEP_MS;
  if (step) since_step_ms = 0;
  for (uint8_t i = 0; i < CT_SERVOS; i++) {
    int16_t *goal = &servo_command.goal[i];
    if (!slow) {
      *goal = goals[i];
    } else if (!(table.servo_torque & 1 << i)) {
      *goal = table.position[i];  // With torque on, it holds this position.
    } else if (step) {
      *goal = one_step(*goal, goals[i]);
    } else {
      // Wait for the next step.
    }
  }
}
