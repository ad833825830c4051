#include "esc.h"

#include "control_table.h"
#include "hal.h"
#include "table.h"

#define LONGEST 4400  // As the limit of pulse_high.

// Runs before memory is set up: the first pulse comes within microseconds of a reset.
void esc_start(void) { hal_esc_start(CT_ZERO_THROTTLE); }

// A division takes 40 us, so it is done once for each throttle and its ends.
static uint16_t pulse(uint8_t i, uint16_t throttle) {
  static uint16_t of[CT_ESCS], width[CT_ESCS], low[CT_ESCS], high[CT_ESCS];
  if (throttle == of[i] && low[i] == table.pulse_low[i] && high[i] == table.pulse_high[i]) return width[i];
  of[i] = throttle;
  low[i] = table.pulse_low[i];
  high[i] = table.pulse_high[i];
  uint32_t share = throttle - CT_ZERO_THROTTLE;
  width[i] = low[i] + share * (high[i] - low[i]) / (CT_FULL_THROTTLE - CT_ZERO_THROTTLE);
  return width[i];
}

void esc_put(const uint16_t *throttle) {
  // The timer takes new widths over between pulses; written between pulses, they need not wait
  // in it for one that is under way.
  if (hal_esc_phase() <= LONGEST) return;
  for (uint8_t i = 0; i < CT_ESCS; i++) {
    hal_esc_put(i, throttle[i] == CT_ZERO_THROTTLE ? table.pulse_low[i] : pulse(i, throttle[i]));
  }
}
