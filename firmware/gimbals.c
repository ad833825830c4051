#include "gimbals.h"

#include <stdbool.h>

#include "table.h"
#include "watchdog.h"

#define ALL ((1 << CT_SERVOS) - 1)
#define NEAR_STEPS 100

static bool reversed(uint8_t i) { return table.reverse & 1 << i; }

static int16_t within_i16(int32_t value) {
  return value > INT16_MAX ? INT16_MAX : value < INT16_MIN ? INT16_MIN : value;
}

void gimbals_start(void) { table.servo_far = ALL & ~watchdog_memory.servos_near; }

void gimbals_forget(void) {
  watchdog_memory.servos_near = table.servo_torque = 0;
  table.servo_far = ALL;
}

static void see(uint8_t i) {
  if (table.position[i] > NEAR_STEPS || table.position[i] < -NEAR_STEPS) return;
  watchdog_memory.servos_near |= 1 << i;
  table.servo_far &= ~(1 << i);
}

uint16_t gimbals_goal(uint8_t i, int16_t steps) {
  int16_t goal = table.neutral[i] + (reversed(i) ? -steps : steps);
  return goal < 0 ? 0 : goal > 4095 ? 4095 : goal;
}

void gimbals_report(uint8_t i, const servo_report_t *report) {
  int32_t position = report->position - table.neutral[i];
  table.position[i] = within_i16(reversed(i) ? -position : position);
  table.velocity[i] = within_i16(reversed(i) ? -report->velocity : report->velocity);
  table.current[i] = reversed(i) ? -report->current : report->current;
  table.voltage[i] = report->voltage;
  table.temperature[i] = report->temperature;
  see(i);
}
