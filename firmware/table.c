#include "table.h"

#include <string.h>

#include "gimbals.h"
#include "hal.h"
#include "power.h"
#include "receiver.h"
#include "robot.h"
#include "safety.h"
#include "servos.h"
#include "setup.h"

control_table_t table;

_Static_assert(sizeof ROBOT_GEOMETRY == CT_GEOMETRY_SIZE, "made for this table");

void table_start(void) {
  uint8_t *bytes = (uint8_t *)&table;
#define X(name, address, type, count, value, rise) \
  for (uint8_t i = 0; i < count; i++) {                                 \
    type it = (type)(value + i * rise);                                 \
    memcpy(bytes + address + i * sizeof it, (const uint8_t *)&it, sizeof it); \
  }
  CT_ITEMS(X)
#undef X
  table.fw = CT_FW_VERSION;
  table.host_baud = HOST_BAUD;
  table.servo_baud = SERVO_BAUD;
  table.build = BUILD_HASH;
  memcpy(bytes + CT_GEOMETRY, ROBOT_GEOMETRY, CT_GEOMETRY_SIZE);
}

static bool within_limits(const uint8_t *bytes) {
#define X(name, address, type, count, least, most)            \
  for (uint8_t i = 0; i < count; i++) {                       \
    type it;                                                  \
    memcpy((uint8_t *)&it, bytes + address + i * sizeof it, sizeof it); \
    int32_t value = it;                                       \
    if (value < (int32_t)least || value > (int32_t)most) return false; \
  }
  CT_WRITABLE(X)
#undef X
  return true;
}

static bool inside(uint16_t address, uint16_t length, uint16_t block, uint16_t size) {
  return address >= block && address < block + size && length <= block + size - address;
}

// A board without telemetry would take the wheels for sensors that never sent.
static bool has_sensor(const control_table_t *wanted) {
  return HAL_TELEMETRY || wanted->wheel_sensor != WHEEL_SENSOR_TELEMETRY;
}

// Changing zero throttle could spin the wheels, so it requires speed controllers without power.
static bool changes_pulses(const control_table_t *wanted) {
  return memcmp(wanted->pulse_low, table.pulse_low, sizeof table.pulse_low) != 0;
}

static bool all_differ(const uint8_t *ids) {
  for (uint8_t i = 1; i < CT_SERVOS; i++) {
    if (memchr(ids, ids[i], i)) return false;
  }
  return true;
}

// A centre outside the stick's ends would drive the robot with the sticks at rest.
static bool sticks_end_where_they_can(const control_table_t *wanted) {
  for (uint8_t i = 0; i < CT_STICKS; i++) {
    uint16_t low = wanted->stick_low[i], high = wanted->stick_high[i];
    uint16_t centre = wanted->stick_centre[i];
    if (low >= high) return false;
    if (i != RC_SPEED && (centre < low || centre > high)) return false;
  }
  return true;
}

// The servos' known positions become invalid.
static bool moves_neutral(const control_table_t *wanted) {
  return wanted->reverse != table.reverse ||
         memcmp(wanted->servo_id, table.servo_id, sizeof table.servo_id) != 0 ||
         memcmp(wanted->neutral, table.neutral, sizeof table.neutral) != 0;
}

answer_t table_write(uint16_t address, const uint8_t *data, uint16_t length) {
  static control_table_t wanted;
  bool setup = inside(address, length, CT_SETUP, CT_SETUP_SIZE);
  bool command = inside(address, length, CT_COMMAND, CT_COMMAND_SIZE);
  if (!setup && !command) return ANSWER_ACCESS;
  if (command && length != CT_COMMAND_SIZE) return ANSWER_LENGTH;
  if (setup && length != CT_SETUP_SIZE) return ANSWER_LENGTH;
  if (setup && !safety_at_rest()) return ANSWER_ACCESS;
  wanted = table;
  memcpy((uint8_t *)&wanted + address, data, length);
  if (!within_limits((const uint8_t *)&wanted)) return ANSWER_RANGE;
  if (!all_differ(wanted.servo_id) || !has_sensor(&wanted)) return ANSWER_RANGE;
  if (!sticks_end_where_they_can(&wanted)) return ANSWER_RANGE;
  if (changes_pulses(&wanted) && power_drive()) return ANSWER_ACCESS;
  if (command) return safety_command(&wanted) ? ANSWER_OK : ANSWER_ACCESS;
  if (memcmp(wanted.servo_id, table.servo_id, sizeof table.servo_id) != 0) servos_renumber();
  if (moves_neutral(&wanted)) gimbals_forget();
  memcpy((uint8_t *)&table + address, data, length);
  setup_written();
  return ANSWER_OK;
}
