#include "sbus.h"

#include "hal.h"

#define HEADER 0x0f
#define MISSED 0x04
#define FAILSAFE 0x08
#define SKIPPED (SBUS_FRAME + 1)
#define PAUSE_MS 2  // Minimum pause between frames is 4 ms; bytes have no pause.
#define ROOM 64     // More than two frames.

void sbus_clear(sbus_decoder_t *decoder) { decoder->count = SKIPPED; }

// Channels have 11 bits each, lowest first.
static uint16_t channel(const uint8_t *data, uint8_t index) {
  uint8_t bit = index * 11 % 8, at = index * 11 / 8;
  uint32_t bits = data[at] | (uint32_t)data[at + 1] << 8;
  if (bit > 5) bits |= (uint32_t)data[at + 2] << 16;
  return (uint16_t)(bits >> bit) & 0x7ff;
}

static sbus_frame_t frame(const uint8_t *bytes, heard_t hear) {
  uint8_t flags = bytes[SBUS_FRAME - 2], last = bytes[SBUS_FRAME - 1];
  // SBUS2 has further types of frames.
  if (last != 0 && (last & 0xcf) != 0x04) return SBUS_NONE;
  if (flags & FAILSAFE) return SBUS_FAILSAFE;
  if (flags & MISSED) return SBUS_NONE;
  for (uint8_t i = 0; i < SBUS_CHANNELS; i++) hear(i, 880 + channel(bytes + 1, i) * 5 / 8);
  return SBUS_CHANNELS_HEARD;
}

sbus_frame_t sbus_push(sbus_decoder_t *decoder, uint8_t byte, bool first, bool broken, heard_t hear) {
  if (first) decoder->count = 0;
  if (broken || (decoder->count == 0 && byte != HEADER)) sbus_clear(decoder);
  if (decoder->count >= SBUS_FRAME) return SBUS_NONE;
  decoder->bytes[decoder->count++] = byte;
  if (decoder->count < SBUS_FRAME) return SBUS_NONE;
  decoder->count = 0;
  return frame(decoder->bytes, hear);
}

static uint8_t in[ROOM], flags_of[ROOM];
static volatile uint8_t in_head, in_tail;
static volatile bool full;
static sbus_decoder_t line;
static uint8_t silent_ms;
static bool failsafe;

HAL_INTERRUPT(radio_byte) {
  uint8_t at = in_head, next = (at + 1) % ROOM;
  flags_of[at] = hal_radio_flags();
  in[at] = hal_radio_receive();
  if (next == in_tail) {
    full = true;
  } else {
    in_head = next;
  }
}

void sbus_start(void) { sbus_clear(&line); }

bool sbus_tick(heard_t hear) {
  bool first = silent_ms >= PAUSE_MS;
  if (silent_ms < PAUSE_MS) silent_ms++;
  if (full) {
    full = false;
    in_tail = in_head;
    sbus_clear(&line);
  }
  while (in_tail != in_head) {
    uint8_t at = in_tail;
    sbus_frame_t heard = sbus_push(&line, in[at], first, flags_of[at] & HAL_BROKEN, hear);
    if (heard != SBUS_NONE) failsafe = heard == SBUS_FAILSAFE;
    first = false;
    silent_ms = 0;
    in_tail = (at + 1) % ROOM;
  }
  return !failsafe;
}
