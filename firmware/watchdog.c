#include "watchdog.h"

#include <avr/io.h>
#include <avr/wdt.h>

#include "control_table.h"
#include "table.h"

#define MAGIC 0x7d5a

// Not cleared at the start.
memory_t watchdog_memory __attribute__((section(".noinit")));
static uint8_t cause __attribute__((section(".noinit")));

_Static_assert(CT_DEFAULT(watchdog_ms) == 250, "as WDTO_250MS");

// Runs before memory is set up: after a watchdog reset the watchdog runs on, at 16 ms.
__attribute__((naked, used, section(".init3"))) void watchdog_start(void);
void watchdog_start(void) {
  cause = MCUSR;
  MCUSR = 0;
  wdt_enable(WDTO_250MS);
}

uint8_t watchdog_reset_cause(void) { return cause; }

void watchdog_remember(void) {
  if (watchdog_memory.magic != MAGIC || (cause & _BV(PORF))) {
    watchdog_memory = (memory_t){.magic = MAGIC};
  } else {
    watchdog_memory.resets++;
  }
}

void watchdog_kick(void) { wdt_reset(); }
