// Setup of the robot in EEPROM. After a reset with spinning wheels, the gimbals must find neutral
// before the PC can write it.
#ifndef SETUP_H
#define SETUP_H

#include <stdbool.h>

// Loads the setup into the table, if stored.
void setup_start(void);

// Whether the setup in the table is valid: loaded, or written since.
bool setup_known(void);

// Starts to store the setup in the table.
void setup_written(void);

// Call every millisecond: stores one byte at a time.
void setup_tick(void);

#endif
