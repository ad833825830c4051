// Parser for the telemetry of a speed controller (KISS, BLHeli_32): packets of ten bytes with a pause after each.
#ifndef ESC_TELEMETRY_H
#define ESC_TELEMETRY_H

#include <stdbool.h>
#include <stdint.h>

#define ESC_TELEMETRY_PACKET 10
#define ESC_TELEMETRY_KEPT 3

typedef struct {
  uint8_t bytes[ESC_TELEMETRY_PACKET];
  uint8_t count;        // At ESC_TELEMETRY_PACKET, bytes are ignored until the next pause.
  uint16_t heard_ms;    // Time of the last byte.
  uint8_t temperature;  // In the last packet, as `consumption`.
  uint16_t consumption;
  uint8_t run, next;  // Packets in sequence, at most ESC_TELEMETRY_KEPT.
  uint16_t kept[ESC_TELEMETRY_KEPT];
} esc_telemetry_t;

void esc_telemetry_clear(esc_telemetry_t *line);

// Adds a byte at a time in ms that may wrap, `broken` if received without stop bit. Returns whether it
// completes a packet with a new speed, in electrical revolutions per minute / 100: the median of three
// packets in sequence, because one of 256 random packets has a correct sum.
bool esc_telemetry_push(esc_telemetry_t *line, uint8_t byte, bool broken, uint16_t now_ms, uint16_t *speed);

#endif
