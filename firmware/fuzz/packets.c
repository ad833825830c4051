// Fuzzer of the parsers for packets from the PC, servo responses and telemetry of speed controllers. Compiled for the PC with the
// address and undefined-behaviour sanitizers: `make fuzz`, then `build/fuzz SEED ROUNDS`. Any error
// ends it.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "crc16.h"
#include "esc_telemetry.h"
#include "packet.h"
#include "servo.h"
#include "table.h"

#define LONGEST 400
#define BODY 60  // Maximum parameters of a packet written and read back.

control_table_t table;  // Provides the servo ids.

static uint32_t state;

static uint32_t draw(uint32_t below) {
  state ^= state << 13;
  state ^= state >> 17;
  state ^= state << 5;
  return state % below;
}

// Many header-like bytes and few distinct values, so that rare states become frequent.
static uint8_t draw_byte(void) {
  static const uint8_t LIKELY[] = {0xff, 0xff, 0xfd, 0x00, 0x55, 0x01, 0x02, 0x03, 200};
  return draw(3) ? LIKELY[draw(sizeof LIKELY)] : (uint8_t)draw(256);
}

static void demand(bool holds, const char *what) {
  if (holds) return;
  fprintf(stderr, "%s\n", what);
  abort();
}

static void inspect(const packet_t *packet, const decoder_t *decoder) {
  const uint8_t *end = packet->parameters + packet->count;
  demand(packet->parameters >= decoder->bytes && end <= decoder->bytes + PACKET_LONGEST,
         "a packet outside its buffer");
  uint32_t sum = 0;
  for (const uint8_t *at = packet->parameters; at < end; at++) sum += *at;
  demand(sum <= 255U * PACKET_LONGEST, "a sum that cannot be");
}

static uint32_t feed(decoder_t *decoder, const uint8_t *bytes, uint32_t count, packet_t *last) {
  uint32_t found = 0;
  packet_t packet;
  for (uint32_t i = 0; i < count; i++) {
    decoder_push(decoder, bytes[i]);
    while (decoder_pending(decoder)) {
      uint16_t before = decoder->crc_errors;
      bool whole = decoder_take(decoder, &packet);
      demand((uint16_t)(decoder->crc_errors - before) <= !whole, "more than one sum at a time");
      if (!whole) continue;
      inspect(&packet, decoder);
      *last = packet;
      found++;
    }
  }
  return found;
}

// Arbitrary bytes; after them and a pause, a valid packet must be decoded.
static void fuzz_decoder(void) {
  decoder_t decoder;
  packet_t packet, last = {0};
  uint8_t bytes[LONGEST], out[PACKET_ROOM], parameters[BODY];
  decoder_clear(&decoder);
  uint32_t count = draw(LONGEST);
  for (uint32_t i = 0; i < count; i++) bytes[i] = draw_byte();
  feed(&decoder, bytes, count, &last);
  while (decoder_give_up(&decoder)) {
    while (decoder_pending(&decoder)) {
      if (decoder_take(&decoder, &packet)) inspect(&packet, &decoder);
    }
  }
  uint8_t length = draw(BODY);
  for (uint8_t i = 0; i < length; i++) parameters[i] = draw_byte();
  uint8_t size = packet_write(out, 200, PACKET_WRITE, parameters, length);
  demand(feed(&decoder, out, size, &last) == 1, "a packet that is not understood");
  demand(last.count == length && !memcmp(last.parameters, parameters, length),
         "a packet that is another");
}

// Longest response to a read, with maximum stuffing.
static void fuzz_longest(void) {
  uint8_t out[PACKET_ROOM], parameters[1 + PACKET_READ_LONGEST];
  static const uint8_t HEADER[] = {0xff, 0xff, 0xfd};
  uint32_t offset = draw(3);
  for (uint32_t i = 0; i < sizeof parameters; i++) parameters[i] = HEADER[(i + offset) % 3];
  uint8_t size = packet_write(out, 200, PACKET_STATUS, parameters, sizeof parameters);
  demand(size <= PACKET_ROOM, "an answer that is longer than its room");
}

// Reads the requested data like the firmware.
static bool fuzz_answer(const protocol_t *protocol, servo_report_t *report) {
  const uint8_t *moving = protocol->data(protocol->moving.size);
  const uint8_t *other = protocol->data(protocol->state.size);
  if (moving) protocol->report_moving(moving, report);
  if (other) protocol->report_state(other, 860, report);
  return moving || other;
}

static void fuzz_servo(const protocol_t *protocol) {
  servo_report_t report = {0};
  uint8_t id = 1 + draw(3);
  protocol->listen();
  for (uint32_t i = 0; i < LONGEST; i++) {
    reply_t reply = protocol->receive(draw_byte(), id);
    if (reply == REPLY_NONE) continue;
    if (reply != REPLY_BROKEN) fuzz_answer(protocol, &report);
    protocol->listen();  // As the firmware does for each request.
  }
}

// A complete and valid response with arbitrary values.
static void fuzz_report(void) {
  uint8_t out[PACKET_ROOM], parameters[22] = {0};
  servo_report_t report = {0};
  for (uint8_t i = 1; i < sizeof parameters; i++) parameters[i] = draw_byte();
  uint8_t size = packet_write(out, 1, PACKET_STATUS, parameters, draw(2) ? 9 : 22);
  PROTOCOL_2.listen();
  reply_t reply = REPLY_NONE;
  for (uint8_t i = 0; i < size; i++) reply = PROTOCOL_2.receive(out[i], 1);
  demand(reply == REPLY_OK && fuzz_answer(&PROTOCOL_2, &report), "an answer that is not understood");
}

// Telemetry at a constant speed, with changed, missing and additional bytes and pauses: no other speed.
static void fuzz_telemetry(void) {
  static const uint8_t PACKET[] = {35, 0x05, 0x78, 0, 250, 0, 7, 0x01, 0x2c, 0x17};
  static esc_telemetry_t line;
  static uint16_t now_ms;
  uint16_t speed = 0, speeds = 0;
  esc_telemetry_clear(&line);
  for (uint32_t packet = 0; packet < 20; packet++) {
    for (uint32_t i = 0; i < sizeof PACKET; i++) {
      uint8_t byte = draw(20) ? PACKET[i] : draw_byte();
      if (draw(100) == 0) now_ms += draw(5);
      for (uint32_t times = draw(50) ? 1 : draw(3); times; times--) {
        if (!esc_telemetry_push(&line, byte, draw(100) == 0, now_ms, &speed)) continue;
        demand(speed == 300, "a speed from broken packets");
        speeds++;
      }
    }
    now_ms += draw(10) ? 29 : draw(100);
  }
  now_ms += 30;
  for (uint32_t i = 0; i < 3 * sizeof PACKET; i++) {
    if (i % sizeof PACKET == 0) now_ms += 30;
    speeds = esc_telemetry_push(&line, PACKET[i % sizeof PACKET], false, now_ms, &speed);
  }
  demand(speeds && speed == 300, "telemetry that is not understood");
}

// Bytes without a meaning, with pauses as between packets: 40 of them have a correct sum.
static void fuzz_noise(void) {
  esc_telemetry_t line = {0};
  uint16_t speed = 0;
  for (uint16_t i = 0; i < 10000; i++) {
    bool whole = esc_telemetry_push(&line, (uint8_t)draw(256), false, i / 10 * 30, &speed);
    demand(!whole, "a speed from noise");
  }
}

int main(int count, char **arguments) {
  if (count != 3) return 2;
  state = (uint32_t)strtoul(arguments[1], NULL, 10) * 2654435761U + 1U;
  uint32_t rounds = (uint32_t)strtoul(arguments[2], NULL, 10);
  crc16_start();
  for (uint32_t i = 0; i < rounds; i++) {
    fuzz_decoder();
    fuzz_longest();
    fuzz_servo(&PROTOCOL_1);
    fuzz_servo(&PROTOCOL_2);
    fuzz_report();
    fuzz_telemetry();
    if (i % 100 == 0) fuzz_noise();
  }
  return 0;
}
