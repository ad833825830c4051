#include "receiver.h"

#include "hal.h"
#include "pulses.h"
#include "sbus.h"
#include "table.h"
#include "watchdog.h"

#define LOST_MS 100
#define SWITCH_US 1500

static uint8_t age_ms[CT_RECEIVER_CHANNELS];
static uint8_t kind;

static void forget(void) {
  for (uint8_t i = 0; i < CT_RECEIVER_CHANNELS; i++) age_ms[i] = 255;
}

void receiver_start(void) {
  forget();
  sbus_start();
  hal_receiver_start();
}

// One of another kind has to be heard first.
static void follow_setup(void) {
  if (kind == table.receiver_kind) return;
  kind = table.receiver_kind;
  forget();
  hal_receiver_serial(kind == RECEIVER_SBUS);
}

void receiver_tick(void) {
  uint16_t us[CT_RECEIVER_CHANNELS] = {0};
  bool no_signal = false;
  follow_setup();
  if (kind == RECEIVER_SBUS) {
    no_signal = sbus_tick(us);
  } else {
    pulses_tick(us);
  }
  for (uint8_t i = 0; i < CT_RECEIVER_CHANNELS; i++) {
    if (age_ms[i] < 255) age_ms[i]++;
    if (us[i]) {
      table.channel[i] = us[i];
      age_ms[i] = 0;
    }
    if (no_signal || age_ms[i] > LOST_MS) table.channel[i] = 0;
  }
  uint32_t map = table.receiver_map;
  for (uint8_t i = 0; i < CT_RC_CHANNELS; i++, map >>= 4) {
    table.rc[i] = table.channel[map & 0xf];
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
