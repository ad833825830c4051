#include "clock.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <util/atomic.h>

static volatile uint8_t pending;

ISR(TIMER2_COMPA_vect) {
  // More than this late, the watchdog is about to end it.
  if (pending != 255) pending++;
  CLOCK_WAKE();
}

void clock_start(void) {
  TCCR5A = 0;
  TCCR5B = _BV(CS51);  // 16 MHz / 8.
  TCCR2A = _BV(WGM21);
  OCR2A = F_CPU / 64 / 1000 - 1;
  TCCR2B = _BV(CS22);  // 16 MHz / 64.
  TIMSK2 = _BV(OCIE2A);
  set_sleep_mode(SLEEP_MODE_IDLE);
}

bool clock_tick(void) {
  bool tick = false;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    if (pending) {
      pending--;
      tick = true;
    }
  }
  return tick;
}

uint16_t clock_half_us(void) {
  uint16_t now = 0;
  // Interrupts read the same timer, through the same hidden byte.
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { now = TCNT5; }
  return now;
}

void clock_sleep(void) {
  cli();
  if (!(GPIOR0 & 1)) {
    sleep_enable();
    sei();  // Takes effect after the next instruction: nothing can come between.
    sleep_cpu();
    sleep_disable();
  }
  GPIOR0 = 0;
  sei();
}
