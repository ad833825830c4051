// UART0, the line to the PC: interrupt-driven input and output.
#ifndef HOST_LINE_H
#define HOST_LINE_H

#include <stdbool.h>
#include <stdint.h>

void host_line_start(void);
bool host_line_receive(uint8_t *byte);
bool host_line_waiting(void);

// Sends all bytes, or nothing if there is not enough room.
void host_line_send(const uint8_t *bytes, uint8_t length);

// Whether received bytes were lost since the last call.
bool host_line_overrun(void);

#endif
