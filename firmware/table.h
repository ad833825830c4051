// The control table as the PC sees it; control_table.h is made from its definition.
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

// Everything in it is touched by the main loop only.
extern control_table_t table;

// What a status packet says.
typedef enum {
  ANSWER_OK = 0,
  ANSWER_INSTRUCTION = 2,
  ANSWER_RANGE = 4,
  ANSWER_LENGTH = 5,
  ANSWER_ACCESS = 7,
} answer_t;

void table_start(void);

// Takes all of a write, or nothing of it. The command block has to be written whole: no half of
// one command is ever put out with half of another.
answer_t table_write(uint16_t address, const uint8_t *data, uint16_t length);

#endif
