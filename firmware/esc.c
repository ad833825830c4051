#include "esc.h"

#include <avr/io.h>

#include "control_table.h"
#include "pins.h"

#define PERIOD (F_CPU / 8 / 50 - 1)

// Runs before memory is set up: the first pulse comes within microseconds of a reset.
void esc_start(void) {
  ESC_DDR |= ESC_PINS;
  OCR4A = OCR4B = OCR4C = CT_ZERO_THROTTLE - 1;
  ICR4 = PERIOD;
  TCCR4A = _BV(COM4A1) | _BV(COM4B1) | _BV(COM4C1) | _BV(WGM41);
  TCNT4 = PERIOD - 1;  // The first pulse begins now, not in 20 ms.
  TCCR4B = _BV(WGM43) | _BV(WGM42) | _BV(CS41);  // Fast PWM up to ICR4, 16 MHz / 8.
}

void esc_put(const uint16_t *half_us) {
  // The timer takes new widths over between pulses; written between pulses, they need not wait
  // in it for one that is under way.
  if (TCNT4 <= CT_FULL_THROTTLE) return;
  OCR4A = half_us[0] - 1;
  OCR4B = half_us[1] - 1;
  OCR4C = half_us[2] - 1;
}
