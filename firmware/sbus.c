#include "sbus.h"

#include "hal.h"

#define HEADER 0x0f
#define MISSED 0x04
#define FAILSAFE 0x08
#define SKIPPED (SBUS_FRAME + 1)
#define PAUSE_HALF_US 2000  // Between frames are 4 ms at least, between bytes none.
#define ROOM 64             // More than two frames.
#define FIRST 0x01          // Not a bit of HAL_BROKEN.

void sbus_clear(sbus_decoder_t *decoder) { decoder->count = SKIPPED; }

// Channels are 11 bits each, the lowest first.
static uint16_t channel(const uint8_t *data, uint8_t index) {
  uint8_t bit = index * 11 % 8, at = index * 11 / 8;
  uint32_t bits = data[at] | (uint32_t)data[at + 1] << 8;
  if (bit > 5) bits |= (uint32_t)data[at + 2] << 16;
  return (uint16_t)(bits >> bit) & 0x7ff;
}

static sbus_frame_t frame(const uint8_t *bytes, uint16_t *us) {
  uint8_t flags = bytes[SBUS_FRAME - 2], last = bytes[SBUS_FRAME - 1];
  // The second version has more kinds of frames.
  if (last != 0 && (last & 0xcf) != 0x04) return SBUS_NONE;
  if (flags & FAILSAFE) return SBUS_FAILSAFE;
  if (flags & MISSED) return SBUS_NONE;
  for (uint8_t i = 0; i < SBUS_CHANNELS; i++) us[i] = 880 + channel(bytes + 1, i) * 5 / 8;
  return SBUS_CHANNELS_HEARD;
}

sbus_frame_t sbus_push(sbus_decoder_t *decoder, uint8_t byte, bool first, bool broken, uint16_t *us) {
  if (first) decoder->count = 0;
  if (broken || (decoder->count == 0 && byte != HEADER)) sbus_clear(decoder);
  if (decoder->count >= SBUS_FRAME) return SBUS_NONE;
  decoder->bytes[decoder->count++] = byte;
  return decoder->count == SBUS_FRAME ? frame(decoder->bytes, us) : SBUS_NONE;
}

static uint8_t in[ROOM], flags_of[ROOM];
static volatile uint8_t in_head, in_tail, missing;
static sbus_decoder_t line;
static bool failsafe;

HAL_INTERRUPT(radio_byte) {
  static uint16_t before;
  uint16_t now = hal_half_us();
  uint8_t flags = hal_radio_flags() & HAL_BROKEN, at = in_head;
  if ((uint16_t)(now - before) > PAUSE_HALF_US) flags |= FIRST;
  before = now;
  in[at] = hal_radio_receive();
  flags_of[at] = flags | missing;
  uint8_t next = (at + 1) % ROOM;
  if (next == in_tail) {
    missing = HAL_OVERRUN;
  } else {
    missing = 0;
    in_head = next;
  }
}

void sbus_start(void) {
  sbus_clear(&line);
}

bool sbus_tick(uint16_t *us) {
  while (in_tail != in_head) {
    uint8_t at = in_tail;
    sbus_frame_t heard = sbus_push(&line, in[at], flags_of[at] & FIRST, flags_of[at] & HAL_BROKEN, us);
    if (heard != SBUS_NONE) failsafe = heard == SBUS_FAILSAFE;
    in_tail = (at + 1) % ROOM;
  }
  return failsafe;
}
