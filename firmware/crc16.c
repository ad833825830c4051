#include "crc16.h"

static uint16_t row[256];

void crc16_start(void) {
  for (uint16_t i = 0; i < 256; i++) {
    uint16_t sum = i << 8;
    for (uint8_t bit = 0; bit < 8; bit++) sum = sum & 0x8000 ? (sum << 1) ^ 0x8005 : sum << 1;
    row[i] = sum;
  }
}

uint16_t crc16(uint16_t sum, const uint8_t *data, uint8_t length) {
  while (length--) sum = (sum << 8) ^ row[(uint8_t)(sum >> 8) ^ *data++];
  return sum;
}
