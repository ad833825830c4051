#include "receiver.h"

#include "hal.h"
#include "table.h"
#include "watchdog.h"

#define LOST_MS 100
#define SWITCH_US 1500
#define SHORTEST_US 800
#define LONGEST_US 2200

static volatile uint16_t width[CT_RC_CHANNELS];  // [0.5 us]
static volatile uint8_t news;
static uint8_t age_ms[CT_RC_CHANNELS];

HAL_INTERRUPT(receiver) {
  static uint8_t before;
  static uint16_t rise[CT_RC_CHANNELS];
  uint16_t now = hal_half_us();
  uint8_t pins = hal_receiver_pins(), changed = pins ^ before;
  before = pins;
  for (uint8_t i = 0, mask = 1; changed; i++, mask <<= 1, changed >>= 1) {
    if (!(changed & 1)) continue;
    if (pins & mask) {
      rise[i] = now;
    } else {
      width[i] = now - rise[i];
      news |= mask;
    }
  }
}

void receiver_start(void) {
  for (uint8_t i = 0; i < CT_RC_CHANNELS; i++) age_ms[i] = 255;
  hal_receiver_start();
}

void receiver_tick(void) {
  uint16_t widths[CT_RC_CHANNELS];
  uint8_t fresh = 0;
  HAL_ATOMIC {
    fresh = news;
    news = 0;
    for (uint8_t i = 0; i < CT_RC_CHANNELS; i++) widths[i] = width[i];
  }
  for (uint8_t i = 0; i < CT_RC_CHANNELS; i++) {
    uint16_t us = widths[i] / 2;
    if (age_ms[i] < 255) age_ms[i]++;
    if (fresh & 1 << i && us >= SHORTEST_US && us <= LONGEST_US) {
      table.rc[i] = us;
      age_ms[i] = 0;
    }
    if (age_ms[i] > LOST_MS) table.rc[i] = 0;
    if (table.rc[i]) watchdog_memory.receiver_seen = true;
  }
}

bool receiver_present(void) {
  for (uint8_t i = 0; i < CT_RC_CHANNELS; i++) {
    if (!table.rc[i]) return false;
  }
  return true;
}

bool receiver_lost(void) {
  return (table.receiver_expected || watchdog_memory.receiver_seen) && !receiver_present();
}

bool receiver_kills(void) { return receiver_present() && table.rc[RC_KILL] <= SWITCH_US; }

bool receiver_manual(void) { return receiver_present() && table.rc[RC_MANUAL] > SWITCH_US; }
