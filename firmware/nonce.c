#include "nonce.h"

#include "hal.h"
#include "table.h"
#include "watchdog.h"

#define CELLS 16     // Used in turn, so that each is written at every 16th power-up.
#define FIRST_CELL 128  // In EEPROM, after the setup. A cell contains a number and its complement.
#define CELL_SIZE 4

// Not cleared at a reset, so that the number changes at each power-up even if EEPROM fails.
static HAL_KEPT uint16_t draws;

static uint16_t word(uint16_t address) {
  return hal_eeprom_read(address) | (uint16_t)hal_eeprom_read(address + 1) << 8;
}

static void put_word(uint16_t address, uint16_t value) {
  hal_eeprom_write(address, value & 0xff);
  hal_eeprom_write(address + 1, value >> 8);
}

static uint16_t address_of(uint16_t starts) { return FIRST_CELL + starts % CELLS * CELL_SIZE; }

// Latest number in the cells; a cell with a wrong complement was not completely written.
static uint16_t newest(void) {
  uint16_t found = 0;
  bool any = false;
  for (uint8_t i = 0; i < CELLS; i++) {
    uint16_t at = address_of(i), starts = word(at);
    bool whole = (starts ^ word(at + 2)) == 0xffff && address_of(starts) == at;
    if (!whole || (any && (int16_t)(starts - found) <= 0)) continue;
    found = starts;
    any = true;
  }
  return found;
}

void nonce_start(void) {
  uint16_t starts = newest();
  // Other resets keep the draws.
  if (watchdog_memory.resets == 0) {
    starts++;
    put_word(address_of(starts), starts);
    put_word(address_of(starts) + 2, ~starts);
  }
  table.nonce[0] = starts;
  nonce_draw();
}

void nonce_draw(void) { table.nonce[1] = ++draws; }

bool nonce_is(const control_table_t *wanted) {
  return wanted->session[0] == table.nonce[0] && wanted->session[1] == table.nonce[1];
}
