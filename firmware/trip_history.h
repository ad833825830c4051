// The last eight trips, kept in EEPROM: neither arming nor a loss of power erases them.
#ifndef TRIP_HISTORY_H
#define TRIP_HISTORY_H

#include "control_table.h"

// Loads the trips into the table.
void trip_history_start(void);

// Records a trip, and starts to store it.
void trip_history_add(trip_code_t code);

// Call when a source gets the robot: begins to record its lowest battery voltage.
void trip_history_begin(void);

// Call every millisecond: stores one byte at a time.
void trip_history_tick(void);

#endif
