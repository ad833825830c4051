#include "power.h"

#include "hal.h"
#include "table.h"
#include "watchdog.h"

#define SAMPLES 4
#define FULL_SCALE 1023UL
#define DRIVE_LEAST_MV 5000
#define EMPTY_MS 1000  // Longer than the voltage drop at a motor start.

// One input per millisecond, in turn. Converting ground in between discharges the sampling
// capacitor, so that a disconnected input reads nearly 0 instead of the previous voltage. The
// bandgap has a high impedance, so its first conversion is discarded.
static const hal_adc_t INPUTS[] = {ADC_GROUND,  ADC_DRIVE,   ADC_GROUND,
                                   ADC_BATTERY, ADC_BANDGAP, ADC_BANDGAP};
#define TURNS (sizeof INPUTS / sizeof INPUTS[0])
static uint8_t turn;
static uint16_t empty_ms;

void power_start(void) {
  hal_adc_start();
  hal_adc_convert(INPUTS[turn]);
}

// Voltage of an input with a divider; `sum` is the sum of SAMPLES conversions.
static uint16_t millivolts(uint16_t sum) {
  return sum * ((uint32_t)table.supply_mv * HAL_DIVIDER) / (FULL_SCALE * SAMPLES);
}

static void measure(void) {
  static uint16_t drive, battery, bandgap;
  static uint8_t samples;
  if (hal_adc_busy()) return;
  if (INPUTS[turn] == ADC_DRIVE) drive += hal_adc_value();
  if (INPUTS[turn] == ADC_BATTERY) battery += hal_adc_value();
  if (turn == TURNS - 1) bandgap += hal_adc_value();
  if (++turn == TURNS) {
    turn = 0;
    if (++samples == SAMPLES) {
      table.supply_mv = bandgap ? table.bandgap_mv * (FULL_SCALE * SAMPLES) / bandgap : 0;
      table.drive_mv = millivolts(drive);
      table.battery_mv = millivolts(battery);
      // Without a battery, a low drive voltage proves nothing.
      if (table.drive_mv < DRIVE_LEAST_MV && table.battery_mv >= DRIVE_LEAST_MV) {
        watchdog_memory.stop_proven = true;
      }
      drive = battery = bandgap = 0;
      samples = 0;
    }
  }
  hal_adc_convert(INPUTS[turn]);
}

bool power_drive(void) {
  // Relative to the battery, so that neither a low battery nor the reference matters.
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
