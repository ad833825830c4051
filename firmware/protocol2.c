// MX-64 with Protocol 2.0 firmware. Source: Robotis e-Manual, "MX-64(2.0)".
#include <string.h>

#include "packet.h"
#include "servo.h"
#include "table.h"

#define TORQUE_ENABLE 64
#define GOAL_POSITION 116
#define VELOCITY 128  // Followed by position (4).
#define CURRENT 126   // Followed by velocity (4), position (4), ..., voltage (2), temperature.
#define STATE 21
#define MOST_SPEED 100000
#define MOST_STEPS 1000000000

static decoder_t decoder;
static packet_t reply;

static uint8_t ping(uint8_t *out, uint8_t id) {
  return packet_write(out, id, PACKET_PING, NULL, 0);
}

static uint8_t set_torque(uint8_t *out, uint8_t id, bool on) {
  uint8_t parameters[] = {TORQUE_ENABLE, 0, on};
  return packet_write(out, id, PACKET_WRITE, parameters, sizeof parameters);
}

static uint8_t read(uint8_t *out, uint8_t id, registers_t registers) {
  uint8_t parameters[] = {registers.address, 0, registers.size, 0};
  return packet_write(out, id, PACKET_READ, parameters, sizeof parameters);
}

static uint8_t set_goals(uint8_t *out, uint8_t mask, const uint16_t *goals) {
  uint8_t parameters[4 + 5 * CT_SERVOS] = {GOAL_POSITION, 0, 4, 0};
  uint8_t count = 4;
  for (uint8_t i = 0; i < CT_SERVOS; i++) {
    if (!(mask & 1 << i)) continue;
    uint8_t goal[] = {table.servo_id[i], goals[i] & 0xff, goals[i] >> 8, 0, 0};
    memcpy(parameters + count, goal, sizeof goal);
    count += sizeof goal;
  }
  if (count == 4) return 0;
  return packet_write(out, PACKET_BROADCAST, PACKET_SYNC_WRITE, parameters, count);
}

static reply_t receive(uint8_t byte, uint8_t id) {
  if (!decoder_push(&decoder, byte)) return REPLY_NONE;
  // Preceding noise may look like a header.
  while (!decoder_take(&decoder, &reply)) {
    if (!decoder_pending(&decoder)) return REPLY_NONE;
  }
  if (reply.id != id || reply.instruction != PACKET_STATUS || !reply.count) return REPLY_BROKEN;
  uint8_t error = reply.parameters[0];
  if (error & ~PACKET_ALERT) return REPLY_BROKEN;
  return error ? REPLY_FAULT : REPLY_OK;
}

static int16_t i16(const uint8_t *bytes) { return bytes[0] | (uint16_t)bytes[1] << 8; }

static int32_t i32(const uint8_t *bytes) {
  return (uint16_t)i16(bytes) | (uint32_t)(uint16_t)i16(bytes + 2) << 16;
}

// A servo may report anything; bound the values so that calculations cannot overflow.
static int32_t within(int32_t value, int32_t most) {
  return value > most ? most : value < -most ? -most : value;
}

static const uint8_t *data(uint8_t size) {
  return reply.count == 1 + size ? reply.parameters + 1 : NULL;
}

static void report_moving(const uint8_t *data, servo_report_t *report) {
  report->velocity = (within(i32(data), MOST_SPEED) * 4002) >> 8;  // 0.229 turns a minute
  report->position = within(i32(data + 4), MOST_STEPS);
}

static void report_state(const uint8_t *data, uint16_t current_unit, servo_report_t *report) {
  report->current = ((int32_t)i16(data) * current_unit) >> 8;
  report->voltage = data[18];
  report->temperature = data[20];
}

static void listen(void) { decoder_clear(&decoder); }

const protocol_t PROTOCOL_2 = {
    .ping = ping,
    .set_torque = set_torque,
    .read = read,
    .set_goals = set_goals,
    .receive = receive,
    .data = data,
    .report_moving = report_moving,
    .report_state = report_state,
    .listen = listen,
    .moving = {VELOCITY, 8},
    .state = {CURRENT, STATE},
    .torque = {TORQUE_ENABLE, 1},
};
