// A ring of eight entries, written in turn, so that each is written at every eighth trip. Power that is lost with
// the drive leaves an entry incomplete: its sum is wrong, and the others are unchanged.
#include "trip_history.h"

#include <string.h>

#include "crc16.h"
#include "hal.h"
#include "table.h"

#define FIRST 192  // In EEPROM, after the cells of nonce.c.
#define ENTRIES 8
#define NUMBERS 64  // Entries are numbered: turns of the ring times ENTRIES, plus the index.
#define CODES 32

typedef struct __attribute__((packed)) {
  uint8_t turn_and_code;  // Turn of the ring in the upper 3 bits, `Trip` in the others.
  uint8_t start;          // Lower byte of the count of power-ups.
  uint16_t uptime_s;
  uint8_t lowest;  // [0.1 V]
  uint16_t sum;
} entry_t;

#define SUMMED (sizeof(entry_t) - sizeof(uint16_t))

static entry_t ring[ENTRIES];
_Static_assert(FIRST + sizeof ring <= HAL_EEPROM_SIZE, "all boards have room for them");
static uint8_t latest;        // Number of the latest entry.
static uint8_t at, to_store;  // Next byte of the ring to be stored, and number of bytes.
static uint16_t uptime_s, uptime_ms;
static uint16_t lowest_mv;

static uint16_t sum_of(const entry_t *entry) { return crc16(0, (const uint8_t *)entry, SUMMED); }

static uint8_t number_of(uint8_t i) { return ring[i].turn_and_code / CODES * ENTRIES + i; }

static bool whole(const entry_t *entry) {
  return entry->turn_and_code % CODES != TRIP_NONE && entry->sum == sum_of(entry);
}

// Fills the table, from the latest to the oldest.
static void show(void) {
  for (uint8_t i = 0; i < ENTRIES; i++) {
    const entry_t *entry = &ring[(uint8_t)(latest - i) % ENTRIES];
    table.past_trip[i] = entry->turn_and_code % CODES;
    table.past_start[i] = entry->start;
    table.past_uptime_s[i] = entry->uptime_s;
    table.past_lowest[i] = entry->lowest;
  }
}

void trip_history_start(void) {
  bool any = false;
  latest = NUMBERS - 1;
  for (uint8_t i = 0; i < sizeof ring; i++) ((uint8_t *)ring)[i] = hal_eeprom_read(FIRST + i);
  for (uint8_t i = 0; i < ENTRIES; i++) {
    uint8_t number = number_of(i);
    if (!whole(&ring[i])) {
      memset(&ring[i], 0, sizeof ring[i]);
    } else if (!any || (uint8_t)(number - latest) % NUMBERS < NUMBERS / 2) {
      latest = number;
      any = true;
    } else {
      // It is older.
    }
  }
  show();
}

void trip_history_add(trip_code_t code) {
  latest = (latest + 1) % NUMBERS;
  uint8_t i = latest % ENTRIES;
  uint8_t lowest = lowest_mv / 100;
  ring[i] = (entry_t){latest / ENTRIES * CODES + code, table.nonce[0] & 0xff, uptime_s, lowest, 0};
  ring[i].sum = sum_of(&ring[i]);
  if (to_store == 0) at = i * sizeof(entry_t);
  // Entries follow each other, also if one comes before the last is stored.
  if (to_store <= sizeof ring - sizeof(entry_t)) to_store += sizeof(entry_t);
  show();
}

void trip_history_begin(void) { lowest_mv = table.battery_mv; }

void trip_history_tick(void) {
  if (++uptime_ms == 1000) {
    uptime_ms = 0;
    if (uptime_s < UINT16_MAX) uptime_s++;
  }
  if (table.battery_mv < lowest_mv) lowest_mv = table.battery_mv;
  if (to_store == 0 || !hal_eeprom_ready()) return;
  hal_eeprom_write(FIRST + at, ((const uint8_t *)ring)[at]);
  to_store--;
  if (++at == sizeof ring) at = 0;
}
