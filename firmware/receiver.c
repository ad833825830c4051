#include "receiver.h"

#include "hal.h"
#include "pulses.h"
#include "sbus.h"
#include "table.h"
#include "watchdog.h"

// A switch turns below or above both, so that a stick or a worn switch in between does not chatter.
#define SWITCH_OFF_US 1500
#define SWITCH_ON_US 1550
#define PERIOD_MS 5
#define OLDEST (100 / PERIOD_MS)

// Channels of both types of receiver: SBUS channels, then wires with pulses.
#define WIRES_FROM CT_RECEIVER_CHANNELS

static uint8_t frame_age, age[CT_RC_CHANNELS];  // [PERIOD_MS]
static uint8_t phase_ms;
static bool changed;
static bool killed = true, manual = false;

void receiver_start(void) {
  sbus_start();
  hal_receiver_start();
}

static void hear_channel(uint8_t channel, uint16_t us) {
  table.channel[channel] = us;
  frame_age = 0;
  changed = true;
}

static void hear_wire(uint8_t wire, uint16_t us) {
  table.channel[WIRES_FROM + wire] = us;
  age[wire] = 0;
  changed = true;
}

static void forget_channels(void) {
  for (uint8_t i = 0; i < CT_RECEIVER_CHANNELS; i++) table.channel[i] = 0;
  changed = true;
}

static bool expires(uint8_t *older) {
  if (*older > OLDEST) return false;
  (*older)++;
  return *older > OLDEST;
}

static void grow_older(void) {
  if (expires(&frame_age)) forget_channels();
  for (uint8_t i = 0; i < CT_RC_CHANNELS; i++) {
    if (expires(&age[i])) table.channel[WIRES_FROM + i] = 0;
  }
  pulses_forget();
  changed = true;  // The setup may have changed.
}

static bool switched(uint16_t us, bool before) {
  return us > SWITCH_ON_US || (before && us > SWITCH_OFF_US);
}

static void map_channels(void) {
  bool sbus = table.receiver_kind == RECEIVER_SBUS;
  uint8_t from = sbus ? 0 : WIRES_FROM;
  uint8_t count = sbus ? CT_RECEIVER_CHANNELS : CT_RC_CHANNELS;
  uint32_t map = table.receiver_map;
  for (uint8_t i = 0; i < CT_RC_CHANNELS; i++, map >>= 4) {
    uint8_t channel = map & 0xf;
    table.rc[i] = channel < count ? table.channel[from + channel] : 0;
    if (table.rc[i]) watchdog_memory.receiver_seen = true;
  }
  killed = !switched(table.rc[RC_KILL], !killed);
  manual = switched(table.rc[RC_MANUAL], manual);
}

// Checks for silence run less often, because this function runs between servo requests.
void receiver_tick(void) {
  if (!sbus_tick(hear_channel)) forget_channels();
  pulses_tick(hear_wire);
  if (++phase_ms == PERIOD_MS) {
    phase_ms = 0;
    grow_older();
  }
  if (changed) map_channels();
  changed = false;
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

bool receiver_kills(void) { return receiver_present() && killed; }

bool receiver_manual(void) { return receiver_present() && manual; }
