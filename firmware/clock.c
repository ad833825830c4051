#include "clock.h"

#include "hal.h"

static volatile uint8_t pending;

HAL_INTERRUPT(tick) {
  // If it is later than this, the watchdog is about to reset the chip.
  if (pending != 255) pending++;
  hal_wake();
}

void clock_start(void) { hal_clock_start(); }

bool clock_tick(void) {
  bool tick = false;
  HAL_ATOMIC {
    if (pending) {
      pending--;
      tick = true;
    }
  }
  return tick;
}

bool clock_waiting(void) { return pending; }

uint16_t clock_half_us(void) {
  uint16_t now = 0;
  // Interrupts read the same timer through the same hidden byte.
  HAL_ATOMIC { now = hal_half_us(); }
  return now;
}
