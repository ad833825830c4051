#include "receiver.h"

#include "hal.h"
#include "pulses.h"
#include "sbus.h"
#include "table.h"
#include "watchdog.h"

#define LOST_MS 100
#define SWITCH_US 1500

// What both kinds of receiver send: channels of SBUS, then wires with pulses.
#define WIRES_FROM CT_RECEIVER_CHANNELS
#define HEARD (CT_RECEIVER_CHANNELS + CT_RC_CHANNELS)

static uint8_t age_ms[HEARD];

void receiver_start(void) {
  for (uint8_t i = 0; i < HEARD; i++) age_ms[i] = 255;
  sbus_start();
  hal_receiver_start();
}

static void hear(void) {
  uint16_t us[HEARD] = {0};
  bool no_signal = sbus_tick(us);
  pulses_tick(us + WIRES_FROM);
  for (uint8_t i = 0; i < HEARD; i++) {
    if (age_ms[i] < 255) age_ms[i]++;
    if (us[i]) {
      table.channel[i] = us[i];
      age_ms[i] = 0;
    }
    bool off = no_signal && i < WIRES_FROM;
    if (off || age_ms[i] > LOST_MS) table.channel[i] = 0;
  }
}

void receiver_tick(void) {
  hear();
  bool sbus = table.receiver_kind == RECEIVER_SBUS;
  const uint16_t *channels = table.channel + (sbus ? 0 : WIRES_FROM);
  uint8_t count = sbus ? CT_RECEIVER_CHANNELS : CT_RC_CHANNELS;
  uint32_t map = table.receiver_map;
  for (uint8_t i = 0; i < CT_RC_CHANNELS; i++, map >>= 4) {
    uint8_t channel = map & 0xf;
    table.rc[i] = channel < count ? channels[channel] : 0;
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
