// Voltages of battery and drive (with dividers) and of the board.
#ifndef POWER_H
#define POWER_H

#include <stdbool.h>

void power_start(void);

// Call every millisecond: updates table.battery_mv and table.drive_mv.
void power_tick(void);

// Whether the speed controllers have power, measured behind the contactor.
bool power_drive(void);

// Too low to arm; too low for a second, which trips.
bool power_low(void);
bool power_empty(void);

#endif
