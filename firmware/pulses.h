// Receiver with one wire per channel: a pulse of 1 to 2 ms every 20 ms.
#ifndef PULSES_H
#define PULSES_H

#include "receiver.h"

// Call every millisecond: reports each new pulse.
void pulses_tick(heard_t hear);

// Call every 5 ms.
void pulses_forget(void);

#endif
