#include "power.h"

#include <avr/io.h>

#include "pins.h"
#include "table.h"

#define SAMPLES 4
#define GROUND 0x1f  // The converter's own 0 V.
#define BANDGAP 0x1e
#define FULL_SCALE 1023UL
#define DRIVE_LEAST_MV 5000
#define EMPTY_MS 1000  // A motor that starts pulls it down for less.

// In turn, one each millisecond. Ground between two inputs empties the sampling capacitor: an input
// whose wire is off reads nearly 0, and not what the other has. The bandgap has a high impedance: its
// first conversion is not used.
static const uint8_t CHANNELS[] = {GROUND, DRIVE_CHANNEL, GROUND, BATTERY_CHANNEL, BANDGAP, BANDGAP};
static uint8_t turn;
static uint16_t empty_ms;

static void convert(void) {
  ADMUX = _BV(REFS0) | CHANNELS[turn];  // Against the supply of 5 V.
  ADCSRA |= _BV(ADSC);
}

void power_start(void) {
  ADCSRA = _BV(ADEN) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);  // 16 MHz / 128.
  convert();
}

// Of inputs over a divider; `sum` is that of SAMPLES.
static uint16_t millivolts(uint16_t sum) {
  return sum * ((uint32_t)table.supply_mv * DIVIDER) / (FULL_SCALE * SAMPLES);
}

static void measure(void) {
  static uint16_t drive, battery, bandgap;
  static uint8_t samples;
  if (ADCSRA & _BV(ADSC)) return;
  if (CHANNELS[turn] == DRIVE_CHANNEL) drive += ADC;
  if (CHANNELS[turn] == BATTERY_CHANNEL) battery += ADC;
  if (turn == sizeof CHANNELS - 1) bandgap += ADC;
  if (++turn == sizeof CHANNELS) {
    turn = 0;
    if (++samples == SAMPLES) {
      table.supply_mv = bandgap ? table.bandgap_mv * (FULL_SCALE * SAMPLES) / bandgap : 0;
      table.drive_mv = millivolts(drive);
      table.battery_mv = millivolts(battery);
      drive = battery = bandgap = 0;
      samples = 0;
    }
  }
  convert();
}

bool power_drive(void) {
  // A share of the battery's, so that neither a low battery nor the reference decides.
  return table.drive_mv >= DRIVE_LEAST_MV && table.drive_mv / 3 >= table.battery_mv / 4;
}

void power_tick(void) {
  measure();
  if (table.battery_mv >= table.battery_stop_mv) {
    empty_ms = 0;
  } else if (empty_ms < EMPTY_MS) {
    empty_ms++;
  }
}

bool power_low(void) { return table.battery_mv < table.battery_arm_mv; }

bool power_empty(void) { return empty_ms == EMPTY_MS; }
