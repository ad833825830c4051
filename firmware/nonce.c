#include "nonce.h"

#include "hal.h"
#include "table.h"

#define STARTS 128  // In EEPROM, behind the setup.

// Not cleared at the start: another number each time power comes, should EEPROM fail.
static HAL_KEPT uint16_t draws;

void nonce_start(void) {
  uint16_t starts = hal_eeprom_read(STARTS) | (uint16_t)hal_eeprom_read(STARTS + 1) << 8;
  starts++;
  hal_eeprom_write(STARTS, starts & 0xff);
  hal_eeprom_write(STARTS + 1, starts >> 8);
  table.nonce[0] = starts;
  nonce_draw();
}

void nonce_draw(void) { table.nonce[1] = ++draws; }

bool nonce_is(const uint16_t *nonce) {
  return nonce[0] == table.nonce[0] && nonce[1] == table.nonce[1];
}
