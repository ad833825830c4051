#include "gimbals.h"

#include <stdbool.h>

#include "table.h"

static bool reversed(uint8_t i) { return table.reverse & 1 << i; }

static int16_t within_i16(int32_t value) {
  return value > INT16_MAX ? INT16_MAX : value < INT16_MIN ? INT16_MIN : value;
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
}
