#include "setup.h"

#include <string.h>

#include "crc16.h"
#include "hal.h"
#include "table.h"

typedef struct __attribute__((packed)) {
  uint8_t version;
  uint8_t bytes[CT_SETUP_SIZE];
  uint16_t sum;
} image_t;

#define SUMMED (sizeof(image_t) - sizeof(uint16_t))

static image_t image;
static uint8_t stored = sizeof(image_t);  // Bytes of the image stored in EEPROM so far.
static bool known;

static uint8_t *in_table(void) { return (uint8_t *)&table + CT_SETUP; }

void setup_start(void) {
  for (uint8_t i = 0; i < sizeof image; i++) ((uint8_t *)&image)[i] = hal_eeprom_read(i);
  uint16_t sum = crc16(0, (const uint8_t *)&image, SUMMED);
  if (image.version != CT_TABLE_VERSION || image.sum != sum) return;
  memcpy(in_table(), image.bytes, CT_SETUP_SIZE);
  known = true;
}

bool setup_known(void) { return known; }

void setup_written(void) {
  known = true;
  image.version = CT_TABLE_VERSION;
  memcpy(image.bytes, in_table(), CT_SETUP_SIZE);
  image.sum = crc16(0, (const uint8_t *)&image, SUMMED);
  stored = 0;
}

void setup_tick(void) {
  // A write takes 3 ms in the background; waiting for it would block everything else.
  if (stored == sizeof image || !hal_eeprom_ready()) return;
  hal_eeprom_write(stored, ((const uint8_t *)&image)[stored]);
  stored++;
}
