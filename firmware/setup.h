// How the robot is built, kept in EEPROM: after a reset with spinning wheels the gimbals have to
// find neutral before its position can be calibrated.
#ifndef SETUP_H
#define SETUP_H

#include <stdbool.h>

// Loads it into the table, if there is one.
void setup_start(void);

// The setup in the table is valid: loaded, or written since.
bool setup_known(void);

// Begins to store the setup of the table.
void setup_written(void);

// To be called each millisecond: stores a byte now and then.
void setup_tick(void);

#endif
