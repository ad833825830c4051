// A receiver with a wire for each channel: a pulse of 1 to 2 ms in 20 ms.
#ifndef PULSES_H
#define PULSES_H

#include "receiver.h"

// To be called each millisecond: tells of each new pulse.
void pulses_tick(heard_t hear);

// To be called each 5 ms.
void pulses_forget(void);

#endif
