#include "esc.h"

#include "control_table.h"
#include "hal.h"
#include "table.h"

#define LONGEST 4400  // Upper limit of pulse_high.

// Runs before memory is set up, so that the first pulse starts within microseconds of a reset.
void esc_start(void) { hal_esc_start(CT_ZERO_THROTTLE); }

static uint16_t stretched(uint16_t throttle, uint16_t low, uint16_t high) {
  uint32_t share = throttle - CT_ZERO_THROTTLE;
  return low + share * (high - low) / (CT_FULL_THROTTLE - CT_ZERO_THROTTLE);
}

void esc_put(void) {
  // The timer applies new widths between pulses. Writing between pulses avoids waiting for a pulse
  // in progress.
  if (hal_esc_phase() <= LONGEST) return;
  for (uint8_t i = 0; i < CT_ESCS; i++) {
    // A division takes 40 us, so do it once per throttle. The pulse range changes only at zero
    // throttle.
    static uint16_t before[CT_ESCS], half_us[CT_ESCS];
    uint16_t throttle = table.throttle_out[i];
    if (throttle == CT_ZERO_THROTTLE) {
      half_us[i] = table.pulse_low[i];
    } else if (throttle != before[i]) {
      half_us[i] = stretched(throttle, table.pulse_low[i], table.pulse_high[i]);
    } else {
      // Unchanged.
    }
    before[i] = throttle;
    hal_esc_put(i, half_us[i]);
  }
}
