// Control table as seen by the PC; control_table.h is generated from its definition.
#ifndef TABLE_H
#define TABLE_H

#include <stdint.h>

#include "control_table.h"

// Values after a reset, as constants.
enum {
#define X(name, address, type, count, value, rise) CT_DEFAULT_##name = (value),
  CT_ITEMS(X)
#undef X
};
#define CT_DEFAULT(name) CT_DEFAULT_##name

// Accessed by the main loop only.
extern control_table_t table;

// Error of a status packet.
typedef enum {
  ANSWER_OK = 0,
  ANSWER_INSTRUCTION = 2,
  ANSWER_RANGE = 4,
  ANSWER_LENGTH = 5,
  ANSWER_ACCESS = 7,
} answer_t;

void table_start(void);

// Applies a write completely or not at all. The command block must be written as a whole, so that
// parts of different commands are never combined.
answer_t table_write(uint16_t address, const uint8_t *data, uint16_t length);

#endif
