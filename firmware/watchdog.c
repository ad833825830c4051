#include "watchdog.h"

#include "control_table.h"
#include "hal.h"
#include "table.h"

#define MAGIC 0x7d5a

// Not cleared at a reset.
HAL_KEPT memory_t watchdog_memory;
static HAL_KEPT uint8_t cause;

_Static_assert(CT_DEFAULT(watchdog_ms) == HAL_WATCHDOG_MS, "as the table says");

// After a watchdog reset the watchdog keeps running, with 16 ms.
void watchdog_start(void) {
  cause = hal_reset_cause();
  hal_watchdog_start();
}

uint8_t watchdog_reset_cause(void) { return cause; }

void watchdog_remember(void) {
  if (watchdog_memory.magic != MAGIC || (cause & HAL_CAUSE_POWER)) {
    watchdog_memory = (memory_t){.magic = MAGIC};
  } else {
    watchdog_memory.resets++;
  }
}

void watchdog_kick(void) { hal_watchdog_kick(); }
