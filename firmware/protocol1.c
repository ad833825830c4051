// MX-64 with its factory firmware, Protocol 1.0. Source: Robotis e-Manual, "MX-64" and "DYNAMIXEL
// Protocol 1.0".
#include <string.h>

#include "control_table.h"
#include "servo.h"
#include "table.h"

#define BROADCAST 0xfe
#define TORQUE_ENABLE 24
#define GOAL_POSITION 30
#define TORQUE_LIMIT 34  // Followed by position (2), speed (2), load (2), voltage, temperature.
#define MOVING 10
#define CURRENT 68
#define FAULTS 0x25  // Overload, overheating, input voltage.

enum { PING = 1, READ = 2, WRITE = 3, SYNC_WRITE = 0x83 };

// FF FF, id, length, error, parameters, checksum.
static uint8_t reply[6 + MOVING];
static uint8_t length;

static uint8_t sum(const uint8_t *bytes, uint8_t count) {
  uint8_t total = 0;
  for (uint8_t i = 0; i < count; i++) total += bytes[i];
  return ~total;
}

static uint8_t request(uint8_t *out, uint8_t id, uint8_t instruction, const uint8_t *parameters,
                       uint8_t count) {
  uint8_t header[] = {0xff, 0xff, id, count + 2, instruction};
  memcpy(out, header, sizeof header);
  if (count) memcpy(out + 5, parameters, count);
  out[5 + count] = sum(out + 2, 3 + count);
  return 6 + count;
}

static uint8_t ping(uint8_t *out, uint8_t id) { return request(out, id, PING, NULL, 0); }

static uint8_t set_torque(uint8_t *out, uint8_t id, bool on) {
  uint8_t parameters[] = {TORQUE_ENABLE, on};
  return request(out, id, WRITE, parameters, sizeof parameters);
}

static uint8_t read(uint8_t *out, uint8_t id, registers_t registers) {
  uint8_t parameters[] = {registers.address, registers.size};
  return request(out, id, READ, parameters, sizeof parameters);
}

static uint8_t set_goals(uint8_t *out, uint8_t mask, const uint16_t *goals) {
  uint8_t parameters[2 + 3 * CT_SERVOS] = {GOAL_POSITION, 2};
  uint8_t count = 2;
  for (uint8_t i = 0; i < CT_SERVOS; i++) {
    if (!(mask & 1 << i)) continue;
    uint8_t goal[] = {table.servo_id[i], goals[i] & 0xff, goals[i] >> 8};
    memcpy(parameters + count, goal, sizeof goal);
    count += sizeof goal;
  }
  if (count == 2) return 0;
  return request(out, BROADCAST, SYNC_WRITE, parameters, count);
}

static reply_t receive(uint8_t byte, uint8_t id) {
  if (length < 2 && byte != 0xff) {
    length = 0;
    return REPLY_NONE;
  }
  if (length == 2 && byte == 0xff) return REPLY_NONE;  // Noise before the header.
  reply[length++] = byte;
  if (length < 4) return REPLY_NONE;
  if (reply[2] != id || reply[3] < 2 || reply[3] > sizeof reply - 4) return REPLY_BROKEN;
  if (length < 4 + reply[3]) return REPLY_NONE;
  if (sum(reply + 2, length - 3) != reply[length - 1]) return REPLY_BROKEN;
  return reply[4] & FAULTS ? REPLY_FAULT : REPLY_OK;
}

static uint16_t u16(const uint8_t *bytes) { return bytes[0] | (uint16_t)bytes[1] << 8; }

static const uint8_t *data(uint8_t size) { return length == 6 + size ? reply + 5 : NULL; }

static void report_moving(const uint8_t *data, servo_report_t *report) {
  uint16_t speed = u16(data + 4);
  int32_t magnitude = ((int32_t)(speed & 0x3ff) * 1992) >> 8;  // 0.114 turns a minute
  report->shut_down = !u16(data);
  report->position = u16(data + 2);
  report->velocity = speed & 0x400 ? -magnitude : magnitude;  // This bit means clockwise.
  report->voltage = data[8];
  report->temperature = data[9];
}

static void report_state(const uint8_t *data, uint16_t current_unit, servo_report_t *report) {
  report->current = (((int32_t)u16(data) - 2048) * current_unit) >> 8;
}

static void listen(void) { length = 0; }

const protocol_t PROTOCOL_1 = {
    .ping = ping,
    .set_torque = set_torque,
    .read = read,
    .set_goals = set_goals,
    .receive = receive,
    .data = data,
    .report_moving = report_moving,
    .report_state = report_state,
    .listen = listen,
    .moving = {TORQUE_LIMIT, MOVING},
    .state = {CURRENT, 2},
    .torque = {TORQUE_ENABLE, 1},
};
