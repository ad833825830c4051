#include "power.h"

#include <avr/io.h>

#include "pins.h"
#include "table.h"

#define SAMPLES 4
#define GROUND 0x1f  // The converter's own 0 V.
#define DRIVE_LEAST_MV 5000

// In turn, one each millisecond. Ground between two inputs empties the sampling capacitor: an input
// whose wire is off reads nearly 0, and not what the other has.
static const uint8_t CHANNELS[] = {GROUND, DRIVE_CHANNEL, GROUND, BATTERY_CHANNEL};
static uint8_t turn;

static void convert(void) {
  ADMUX = _BV(REFS0) | CHANNELS[turn];  // Against the supply of 5 V.
  ADCSRA |= _BV(ADSC);
}

void power_start(void) {
  ADCSRA = _BV(ADEN) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);  // 16 MHz / 128.
  convert();
}

void power_tick(void) {
  static uint16_t drive, battery;
  static uint8_t samples;
  if (ADCSRA & _BV(ADSC)) return;
  if (CHANNELS[turn] == DRIVE_CHANNEL) drive += ADC;
  if (CHANNELS[turn] == BATTERY_CHANNEL) battery += ADC;
  if (++turn == sizeof CHANNELS) {
    turn = 0;
    if (++samples == SAMPLES) {
      table.drive_mv = drive * (ADC_REFERENCE_MV * DIVIDER) / (1023UL * SAMPLES);
      table.battery_mv = battery * (ADC_REFERENCE_MV * DIVIDER) / (1023UL * SAMPLES);
      drive = battery = 0;
      samples = 0;
    }
  }
  convert();
}

bool power_drive(void) {
  // A share of the battery's, so that neither a low battery nor the reference decides.
  return table.drive_mv >= DRIVE_LEAST_MV && table.drive_mv / 3 >= table.battery_mv / 4;
}
