// UART0, the line to the PC: bytes in and out, by interrupts.
#ifndef HOST_LINE_H
#define HOST_LINE_H

#include <stdbool.h>
#include <stdint.h>

void host_line_start(void);
bool host_line_receive(uint8_t *byte);
bool host_line_waiting(void);

// Sends all of it, or nothing when there is no room.
void host_line_send(const uint8_t *bytes, uint8_t length);

// Whether bytes came faster than they were fetched, since the last call.
bool host_line_overrun(void);

#endif
