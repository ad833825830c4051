#include "esc.h"

#include "control_table.h"
#include "hal.h"

// Runs before memory is set up: the first pulse comes within microseconds of a reset.
void esc_start(void) { hal_esc_start(CT_ZERO_THROTTLE); }

void esc_put(const uint16_t *half_us) {
  // The timer takes new widths over between pulses; written between pulses, they need not wait
  // in it for one that is under way.
  if (hal_esc_phase() <= CT_FULL_THROTTLE) return;
  for (uint8_t i = 0; i < CT_ESCS; i++) hal_esc_put(i, half_us[i]);
}
