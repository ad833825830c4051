// The three speed controllers: pulses made by hardware, 50 a second.
#ifndef ESC_H
#define ESC_H

#include <stdbool.h>

#include "hal.h"

// Begins with zero throttle: a controller that sees more when it gets power may take it for the
// start of its calibration. No caller is needed, the start of the program runs it.
HAL_AT_RESET void esc_start(void);

// Puts table.throttle_out out from the next pulse on, stretched to the ends of each controller's pulses.
void esc_put(void);

#endif
