// Number of a session: a command that arms, or is a beat, has to carry it. What was recorded in
// another session therefore arms nothing when it is sent again.
#ifndef NONCE_H
#define NONCE_H

#include <stdbool.h>

#include "control_table.h"

// Counts a power-up in EEPROM, and draws the first.
void nonce_start(void);

// Draws another into table.nonce; no earlier one comes again.
void nonce_draw(void);

// Whether the command is of this session.
bool nonce_is(const control_table_t *wanted);

#endif
