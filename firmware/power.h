// Voltages of the battery and of the drive, each over a divider, and of the board.
#ifndef POWER_H
#define POWER_H

#include <stdbool.h>

void power_start(void);

// To be called each millisecond: brings table.battery_mv and table.drive_mv up to date.
void power_tick(void);

// The speed controllers have power: the voltage behind the contactor is there.
bool power_drive(void);

// Too low to arm; too low to go on, for a second.
bool power_low(void);
bool power_empty(void);

#endif
