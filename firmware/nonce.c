#include "nonce.h"

#include <avr/eeprom.h>

#include "table.h"

#define STARTS ((uint16_t *)128)  // In EEPROM, behind the setup.

// Not cleared at the start: another number each time power comes, should EEPROM fail.
static uint16_t draws __attribute__((section(".noinit")));

void nonce_start(void) {
  uint16_t starts = eeprom_read_word(STARTS) + 1;
  eeprom_update_word(STARTS, starts);
  table.nonce[0] = starts;
  nonce_draw();
}

void nonce_draw(void) { table.nonce[1] = ++draws; }

bool nonce_is(const uint16_t *nonce) {
  return nonce[0] == table.nonce[0] && nonce[1] == table.nonce[1];
}
