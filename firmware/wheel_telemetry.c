#include "wheel_telemetry.h"

#include <stdbool.h>

#include "esc_telemetry.h"
#include "hal.h"
#include "table.h"

#define ROOM 128      // Bytes that wait for the main loop: more than three packets of each wheel.
#define LOST_MS 150  // Five packets.

static struct {
  uint8_t wheel;
  int16_t byte;
} in[ROOM];
static volatile uint8_t head, tail;
static volatile bool full;
static esc_telemetry_t lines[CT_ESCS];
static uint16_t updated_ms[CT_ESCS];
static uint8_t heard;

void wheel_telemetry_take(void) {
  for (uint8_t i = 0; i < CT_ESCS; i++) {
    for (int16_t byte = hal_telemetry_take(i); byte >= 0; byte = hal_telemetry_take(i)) {
      uint8_t at = head, next = (at + 1) % ROOM;
      if (next == tail) {
        full = true;
        continue;
      }
      in[at].wheel = i;
      in[at].byte = byte;
      head = next;
    }
  }
}

void wheel_telemetry_start(void) {
  tail = head;
  heard = 0;
  for (uint8_t i = 0; i < CT_ESCS; i++) esc_telemetry_clear(&lines[i]);
}

static void update(uint8_t i, uint16_t erpm, uint16_t now_ms) {
  uint32_t rpm = 100UL * erpm / table.wheel_pulses;
  table.wheel_rpm[i] = rpm > UINT16_MAX ? UINT16_MAX : rpm;
  table.wheel_measured |= 1 << i;
  heard |= 1 << i;
  updated_ms[i] = now_ms;
}

static void grow_old(uint8_t i, uint16_t now_ms) {
  uint16_t age_ms = now_ms - updated_ms[i];
  if (!(table.wheel_measured & 1 << i)) return;
  table.wheel_age[i] = age_ms;
  if (age_ms < LOST_MS) return;
  // A speed controller without power is silent while its wheel runs down: the speed is unknown.
  esc_telemetry_clear(&lines[i]);
  table.wheel_measured &= ~(1 << i);
  table.wheel_rpm[i] = 0;
  table.wheel_age[i] = UINT8_MAX;
}

void wheel_telemetry_tick(void) {
  uint16_t now_ms = (uint16_t)table.millis, erpm = 0;
  if (full) {  // Bytes are missing because the main loop was late.
    tail = head;
    full = false;
    for (uint8_t i = 0; i < CT_ESCS; i++) lines[i].count = ESC_TELEMETRY_PACKET;
  }
  while (tail != head) {
    uint8_t at = tail, i = in[at].wheel;
    bool broken = in[at].byte & HAL_TELEMETRY_BROKEN;
    if (esc_telemetry_push(&lines[i], (uint8_t)in[at].byte, broken, now_ms, &erpm)) update(i, erpm, now_ms);
    tail = (at + 1) % ROOM;
  }
  for (uint8_t i = 0; i < CT_ESCS; i++) grow_old(i, now_ms);
}

uint8_t wheel_telemetry_heard(void) { return heard; }
