// A receiver with a wire for each channel: a pulse of 1 to 2 ms in 20 ms.
#ifndef PULSES_H
#define PULSES_H

#include <stdint.h>

// To be called each millisecond: writes the width of each new pulse, in microseconds.
void pulses_tick(uint16_t *us);

#endif
