// Session number, which commands that arm or count as a heartbeat must contain. Replaying commands
// recorded in an earlier session therefore cannot arm.
#ifndef NONCE_H
#define NONCE_H

#include <stdbool.h>

#include "control_table.h"

// Counts a power-up in EEPROM and draws the first number.
void nonce_start(void);

// Draws a new number into table.nonce; numbers do not repeat.
void nonce_draw(void);

// Whether the command belongs to this session.
bool nonce_is(const control_table_t *wanted);

#endif
