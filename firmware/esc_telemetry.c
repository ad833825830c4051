#include "esc_telemetry.h"

#define PAUSE_MS 2  // Bytes of a packet have no pause; packets are about 30 ms apart.
#define WARMER_C 10
#define MORE_MAH 10

enum { TEMPERATURE = 0, VOLTAGE = 1, CONSUMPTION = 5, SPEED = 7, SUM = 9 };

void esc_telemetry_clear(esc_telemetry_t *line) {
  line->count = ESC_TELEMETRY_PACKET;
  line->run = 0;
}

static uint16_t word(const uint8_t *bytes) { return (uint16_t)(bytes[0] << 8 | bytes[1]); }

// CRC-8 with the polynomial 0x07.
static uint8_t sum(const uint8_t *bytes) {
  uint8_t crc = 0;
  for (uint8_t i = 0; i < SUM; i++) {
    crc ^= bytes[i];
    for (uint8_t bit = 0; bit < 8; bit++) crc = (uint8_t)(crc << 1 ^ (crc & 0x80 ? 0x07 : 0));
  }
  return crc;
}

// Whether the packet can follow the last one, from its temperature and consumed charge.
static bool continues(const esc_telemetry_t *line) {
  int16_t warmer = line->bytes[TEMPERATURE] - line->temperature;
  uint16_t more = word(line->bytes + CONSUMPTION) - line->consumption;
  return warmer >= -WARMER_C && warmer <= WARMER_C && more <= MORE_MAH;
}

static uint16_t median(const uint16_t *of) {
  uint16_t low = of[0] < of[1] ? of[0] : of[1], high = of[0] < of[1] ? of[1] : of[0];
  return of[2] < low ? low : of[2] > high ? high : of[2];
}

static bool take(esc_telemetry_t *line, uint16_t *speed) {
  const uint8_t *bytes = line->bytes;
  // Only zeros have a correct sum, but a speed controller that sends has a voltage.
  if (sum(bytes) != bytes[SUM] || word(bytes + VOLTAGE) == 0) return false;
  if (!continues(line)) line->run = 0;
  line->temperature = bytes[TEMPERATURE];
  line->consumption = word(bytes + CONSUMPTION);
  line->kept[line->next] = word(bytes + SPEED);
  if (++line->next == ESC_TELEMETRY_KEPT) line->next = 0;
  if (line->run < ESC_TELEMETRY_KEPT) line->run++;
  if (line->run < ESC_TELEMETRY_KEPT) return false;
  *speed = median(line->kept);
  return true;
}

bool esc_telemetry_push(esc_telemetry_t *line, uint8_t byte, bool broken, uint16_t now_ms, uint16_t *speed) {
  uint16_t pause_ms = now_ms - line->heard_ms;
  line->heard_ms = now_ms;
  if (pause_ms >= PAUSE_MS) line->count = 0;
  if (broken) line->count = ESC_TELEMETRY_PACKET;
  if (line->count >= ESC_TELEMETRY_PACKET) return false;
  line->bytes[line->count++] = byte;
  return line->count == ESC_TELEMETRY_PACKET && take(line, speed);
}
