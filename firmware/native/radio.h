// Output of an SBUS receiver: a frame of 25 bytes every 7 ms.
#ifndef RADIO_H
#define RADIO_H

#include <stdint.h>
#include <string.h>

#define RADIO_FRAME 25
#define RADIO_PERIOD_US 7000
#define RADIO_CHANNELS 16

// Channels as pulse widths, centred beyond `count`; `flags` as set by the receiver.
static inline void radio_frame(uint8_t *out, const uint32_t *us, uint32_t count, uint8_t flags) {
  memset(out, 0, RADIO_FRAME);
  out[0] = 0x0f;
  for (uint32_t i = 0; i < RADIO_CHANNELS; i++) {
    uint32_t width = i < count ? us[i] : 1500;
    uint32_t value = width < 880 ? 0 : (width - 880) * 8 / 5;
    if (value > 2047) value = 2047;
    for (uint32_t bit = 0; bit < 11; bit++) {
      uint32_t at = 11 * i + bit;
      if (value >> bit & 1) out[1 + at / 8] |= (uint8_t)(1 << at % 8);
    }
  }
  out[RADIO_FRAME - 2] = flags;
}

#endif
