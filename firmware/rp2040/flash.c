// Each version of the memory is a page with a number and a CRC; a version is never overwritten, so
// a loss of power leaves the one before. When one sector is half full, the other is erased, long
// before it is needed. No function waits: the program
// continues while the flash writes or erases.
#include "flash.h"

#include <stdbool.h>
#include <string.h>

#include "../crc16.h"
#include "../hal.h"
#include "registers.h"

#define PAGE 256u
#define PAGES 32u  // In two sectors.
#define HALF (PAGES / 2u)
#define SECTORS 0x1fe000u
#define SETTLE_MS 10  // After a change, further ones usually follow.

#define READ 0x03u
#define READ_STATUS 0x05u
#define ENABLE 0x06u
#define PROGRAM 0x02u
#define ERASE 0x20u
#define BUSY BIT(0)

typedef struct {
  uint16_t number;
  uint8_t bytes[PAGE - 2 * sizeof(uint16_t)];
  uint16_t sum;
} page_t;
_Static_assert(sizeof(page_t) == PAGE, "a page of the flash");

static page_t page;
static uint32_t next;  // Free page.
static bool erase[2];  // Sectors to be erased.
static volatile uint8_t settle_ms;

// The interface stays in plain serial mode: 8 bits at a time, a quarter of the system clock.
static void serial(void) {
  REGISTER(SSI + 0x08u) = 0;
  REGISTER(SSI + 0x14u) = 4;
  REGISTER(SSI + 0x00u) = 7u << 16;
  REGISTER(SSI + 0x10u) = 1;
  REGISTER(SSI + 0x08u) = 1;
}

static void select(bool on) { REGISTER(IO_QSPI_SS_CTRL) = (on ? 2u : 3u) << 8; }

static uint8_t exchange(uint8_t byte) {
  REGISTER(SSI + 0x60u) = byte;
  while (!(REGISTER(SSI + 0x28u) & BIT(3))) {
  }
  return REGISTER(SSI + 0x60u);
}

static void begin(uint8_t command, uint32_t address) {
  select(true);
  exchange(command);
  exchange(address >> 16);
  exchange(address >> 8);
  exchange(address);
}

static void enable(void) {
  select(true);
  exchange(ENABLE);
  select(false);
}

static bool busy(void) {
  select(true);
  exchange(READ_STATUS);
  bool is = exchange(0) & BUSY;
  select(false);
  return is;
}

static void load(uint32_t index, page_t *found) {
  begin(READ, SECTORS + index * PAGE);
  for (uint32_t i = 0; i < PAGE; i++) ((uint8_t *)found)[i] = exchange(0);
  select(false);
}

static uint16_t sum_of(const page_t *it) {
  return crc16(0, (const uint8_t *)it, PAGE - sizeof it->sum);
}

static bool blank(const page_t *it) {
  for (uint32_t i = 0; i < PAGE; i++) {
    if (((const uint8_t *)it)[i] != 0xff) return false;
  }
  return true;
}

void flash_start(void) {
  static page_t found;
  static bool free_page[PAGES];
  bool any = false;
  uint32_t newest = PAGES - 1;
  memset(&page, 0xff, PAGE);
  serial();
  // After a reset, an erasure may still be running; it takes at most 0.4 s.
  for (uint32_t i = 0; i < 200000 && busy(); i++) hal_watchdog_kick();
  for (uint32_t i = 0; i < PAGES; i++) {
    load(i, &found);
    free_page[i] = blank(&found);
    if (found.sum != sum_of(&found) || free_page[i]) continue;
    if (any && (int16_t)(found.number - page.number) <= 0) continue;
    page = found;
    newest = i;
    any = true;
  }
  if (!any) page.number = 0;
  // Skip a page that was not completely written.
  for (next = (newest + 1) % PAGES; next % HALF && !free_page[next];) next = (next + 1) % PAGES;
  for (uint32_t i = 0; i < PAGES; i++) {
    bool needed = i / HALF == next / HALF ? next % HALF == 0 : next % HALF >= HALF / 2;
    if (!free_page[i] && needed) erase[i / HALF] = true;
  }
}

void flash_tick(void) {
  static bool writing = false;
  if (settle_ms > 1) settle_ms--;
  if (writing && busy()) return;
  writing = false;
  for (uint32_t i = 0; i < 2; i++) {
    if (!erase[i]) continue;
    erase[i] = false;
    enable();
    begin(ERASE, SECTORS + i * HALF * PAGE);
    select(false);
    writing = true;
    return;
  }
  if (settle_ms != 1) return;
  settle_ms = 0;
  page.number++;
  page.sum = sum_of(&page);
  enable();
  begin(PROGRAM, SECTORS + next * PAGE);
  for (uint32_t i = 0; i < PAGE; i++) exchange(((const uint8_t *)&page)[i]);
  select(false);
  writing = true;
  next = (next + 1) % PAGES;
  if (next % HALF == HALF / 2) erase[1 - next / HALF] = true;
}

uint8_t hal_eeprom_read(uint16_t address) {
  return address < sizeof page.bytes ? page.bytes[address] : 0xff;
}

bool hal_eeprom_ready(void) { return true; }

void hal_eeprom_write(uint16_t address, uint8_t byte) {
  if (address >= sizeof page.bytes || page.bytes[address] == byte) return;
  HAL_ATOMIC {
    page.bytes[address] = byte;
    settle_ms = SETTLE_MS;
  }
}
