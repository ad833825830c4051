#include "battery.h"

#include <avr/io.h>

#include "pins.h"
#include "table.h"

#define SAMPLES 16

void battery_start(void) {
  ADMUX = _BV(REFS0) | BATTERY_CHANNEL;  // Against the supply of 5 V.
  ADCSRA = _BV(ADEN) | _BV(ADSC) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);  // 16 MHz / 128.
}

void battery_tick(void) {
  static uint16_t sum;
  static uint8_t samples;
  if (ADCSRA & _BV(ADSC)) return;
  sum += ADC;
  if (++samples == SAMPLES) {
    table.battery_mv = sum * (ADC_REFERENCE_MV * BATTERY_DIVIDER) / (1023UL * SAMPLES);
    sum = 0;
    samples = 0;
  }
  ADCSRA |= _BV(ADSC);
}
